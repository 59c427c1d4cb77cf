# SPDX-License-Identifier: Apache-2.0
"""Properties that are computed once, for one instance while they are for another."""

from threading import Barrier, Thread

from cfd_pneumatic.lazy import lazy_property


class Owner:
    """Meets another instance while both compute."""

    def __init__(self, meet: Barrier) -> None:
        self.meet = meet
        self.computed = 0

    @lazy_property
    def answer(self) -> int:
        """What is computed."""
        self.computed += 1
        self.meet.wait(10.0)
        return 42


def test_two_instances_compute_at_once_and_each_once() -> None:
    meet = Barrier(2)
    both = Owner(meet), Owner(meet)
    threads = [Thread(target=lambda one=one: one.answer) for one in both]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [(one.answer, one.computed) for one in both] == [(42, 1), (42, 1)]


def test_the_class_tells_what_it_is() -> None:
    assert Owner.answer.__doc__ == 'What is computed.'
