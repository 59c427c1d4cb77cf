# SPDX-License-Identifier: Apache-2.0
"""The limit of a search: what it counts, that its answer repeats, and how a user ends or lifts it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import pytest

from cfd_pneumatic.identification import Options, identify, progress
from cfd_pneumatic.identification.data import Effort
from cfd_pneumatic.recording import read_mapping, read_recording
from cfd_pneumatic.reporting import report_data
from studies.foreign.devices import record
from studies.foreign.tables import FORMATS, write_table


@pytest.fixture(scope='module')
def foreign(tmp_path_factory):
    """Return a recording that neither core nor effects explain: a regulator with integral action."""
    folder = tmp_path_factory.mktemp('foreign')
    table, mapping = write_table(record('pi_spool', 4), next(iter(FORMATS)), folder)
    return read_recording(table, mapping=read_mapping(mapping))


@pytest.fixture(autouse=True, scope='module')
def small_limit():
    """Limit the search to some trials of effects, so that the tests are quick."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(progress, 'LARGEST_EFFORT', 6e6)
        patch.setattr(progress, 'LARGEST_EFFORT_PER_STEP', 0.0)
        yield


@pytest.fixture(scope='module')
def limited(foreign):
    return identify([foreign], Options(close_loop=True))


def test_threads_count_every_step():
    effort = Effort()
    with ThreadPoolExecutor(8) as threads:
        list(threads.map(effort.add, [1.0] * 20_000))
    assert effort.spent == 20_000


def test_a_share_limits_what_may_begin_within_it_only():
    effort = Effort(limit=100.0)
    effort.add(20.0)
    with effort.share(0.5):  # up to 60
        assert effort.allows('small', 39.0)
        assert not effort.allows('large', 41.0)
        with effort.share(0.5):  # up to 40
            assert not effort.allows('inner', 21.0)
    assert effort.allows('large', 79.0)
    assert effort.skipped == ('large', 'inner')


def test_the_fits_of_the_answer_have_no_limit():
    effort = Effort(limit=100.0)
    effort.add(200.0)
    assert effort.room == 0.0
    with effort.lifted():
        assert effort.allows('the last fit', 1e12)
    assert not effort.allows('a further effect')
    assert effort.skipped == ('a further effect',)


def test_a_limit_may_be_extended():
    effort = Effort(limit=100.0)
    effort.add(90.0)
    with effort.share(0.5):
        effort.extend(2.0)
        assert effort.room == 105.0
    assert effort.limit == 200.0
    assert effort.room == 110.0
    effort.extend(2.0)
    assert effort.limit == 200.0, 'once in a search'


def test_as_many_items_begin_as_the_effort_suffices_for():
    effort = Effort(limit=100.0)
    effort.add(30.0)
    assert effort.affordable('all', 'abc', 20.0) == 'abc'
    assert effort.skipped == ()
    assert effort.affordable('some', 'abcd', 20.0) == 'abc'
    assert effort.affordable('none', 'abcd', 80.0) == ''
    assert effort.skipped == ('some', 'none')
    assert Effort().affordable('all', 'abcd', 1e12) == 'abcd'


def test_without_a_limit_everything_may_begin():
    effort = Effort()
    effort.add(1e12)
    with effort.share(0.1):
        assert effort.allows('anything', 1e12)
    assert effort.skipped == ()


def test_a_stopped_search_begins_nothing():
    effort = Effort(is_stopped=lambda: True)
    assert not effort.allows('anything')


def test_a_limited_search_names_what_it_did_not_try_and_repeats_its_answer(foreign, limited):
    data = report_data(limited)
    assert data['cylinders']['cylinder_a']['not_tried']
    assert data['interrupted'] is False
    assert report_data(identify([foreign], Options(close_loop=True))) == data


def test_no_trial_has_a_negative_share(limited):
    tried = limited.cylinders['cylinder_a'].findings.tried
    assert tried
    assert all(trial.rss_drop >= 0.0 for trial in tried)


def test_the_search_ends_soon_after_a_stop_with_the_best_answer_so_far(foreign):
    questions = []

    def show(what, _share):
        if 'effects with' in what:
            questions.append(what)

    stopped = identify([foreign], Options(close_loop=True), show, lambda: len(questions) > 1)
    assert stopped.is_interrupted
    assert report_data(stopped)['interrupted'] is True
    assert len({what.partition(',')[0] for what in questions}) <= 2
    findings = stopped.cylinders['cylinder_a'].findings
    assert findings.not_tried
    assert stopped.cylinders['cylinder_a'].rmse(1) <= stopped.cylinders['cylinder_a'].rmse(0)


def test_progress_rises_and_tells_the_error_so_far(foreign):
    shown = []
    identify([foreign], Options(close_loop=True), lambda what, share: shown.append((what, share)))
    shares = [share for _, share in shown]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert any('effects with the linear core, error ' in what and 'times the noise' in what for what, _ in shown)
