# SPDX-License-Identifier: Apache-2.0
"""A cluster that lets in who has its certificate: a real scheduler, a real worker, real clients."""

from __future__ import annotations

import gc
import os
import re
import shutil
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    PrivateFormat,
    load_pem_private_key,
)
from distributed.utils import LoopRunner
from patience import allowed, wait_until

from cfd_pneumatic.commands.dask_certificate import main as dask_certificate
from cfd_pneumatic.commands.identify_bag import main as identify_bag
from cfd_pneumatic.errors import InputError
from cfd_pneumatic.plant import existing_cluster, is_open
from cfd_pneumatic.recording import recording_of, write_recording
from cfd_pneumatic.rig import out_and_back, record


@pytest.fixture(scope='module')
def certificate(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp('cluster') / 'certificate'
    assert dask_certificate([str(folder)]) == 0
    return folder


@pytest.fixture(scope='module')
def scheduler(certificate, tmp_path_factory):
    """Yield the address of a scheduler with a worker, started as `dask_certificate` says."""
    file, key = certificate / 'dask.pem', certificate / 'dask.key'
    secured = ['--tls-ca-file', file, '--tls-cert', file, '--tls-key', key]
    dask = [
        sys.executable,
        '-m',
        'distributed.cli.dask_scheduler',
        '--protocol',
        'tls',
        '--host',
        '127.0.0.1',
        '--port',
        '0',
    ]
    dask.append('--no-dashboard')
    log = tmp_path_factory.mktemp('scheduler') / 'log'
    with (
        log.open('w') as stream,
        subprocess.Popen([*dask, '--port', '0', '--no-dashboard', *secured], stderr=stream) as one,
    ):
        try:
            address = said_address(log)
            dask = [sys.executable, '-m', 'distributed.cli.dask_worker', address, '--nthreads=1', '--no-nanny']
            with subprocess.Popen([*dask, '--no-dashboard', *secured], stderr=subprocess.DEVNULL) as worker:
                try:
                    yield address
                finally:
                    worker.kill()
        finally:
            one.kill()


def said_address(log: Path) -> str:
    """Return the address that a scheduler says once it is ready."""
    return wait_until(lambda: re.search(r'Scheduler at:\s+(tls://\S+)', log.read_text()), found=log.read_text)[1]


def test_only_the_owner_may_read_the_key_and_none_is_overwritten(certificate, capsys):
    assert stat.S_IMODE((certificate / 'dask.key').stat().st_mode) == 0o600
    before = (certificate / 'dask.key').read_bytes()
    assert dask_certificate([str(certificate)]) == 2
    assert f'{certificate}/dask.key exists and may be yours' in capsys.readouterr().err
    assert (certificate / 'dask.key').read_bytes() == before


def test_a_certificate_is_replaced_beside_what_is_somebody_s_own(tmp_path):
    (tmp_path / 'notes').write_text('mine')
    keys = set()
    for overwrite in ([], ['--overwrite']):
        assert dask_certificate([str(tmp_path), *overwrite]) == 0
        keys.add((tmp_path / 'dask.key').read_bytes())
        assert stat.S_IMODE((tmp_path / 'dask.key').stat().st_mode) == 0o600
    assert len(keys) == 2
    assert {path.name for path in tmp_path.iterdir()} == {'dask.key', 'dask.pem', 'notes'}


def test_who_has_the_certificate_is_let_in_and_nobody_else(scheduler, certificate, tmp_path, monkeypatch):
    assert scheduler.startswith('tls://')
    with existing_cluster(scheduler, certificate) as client:
        client.wait_for_workers(1, timeout=allowed())
        assert client.submit(os.getpid).result(allowed()) != os.getpid()
    assert dask_certificate([str(tmp_path / 'another')]) == 0
    monkeypatch.setattr('cfd_pneumatic.plant.cluster._PATIENCE', '2s')
    for address in (scheduler, scheduler.replace('tls://', 'tcp://')):
        for other in (None, tmp_path / 'another'):
            with pytest.raises(InputError, match='no Dask scheduler answers'), existing_cluster(address, other):
                pass


@pytest.mark.parametrize('secured', [False, True])
def test_nothing_is_left_of_a_client_that_could_not_begin(scheduler, certificate, monkeypatch, secured):
    """What the garbage collector finds it closes, for which it wants the lock that another client may begin with."""
    monkeypatch.setattr('cfd_pneumatic.plant.cluster._PATIENCE', '2s')
    address = scheduler.replace('tls://', 'tcp://')
    with pytest.raises(InputError), existing_cluster(address, certificate if secured else None):
        pass
    with LoopRunner._lock:
        collector = threading.Thread(target=gc.collect, daemon=True)
        collector.start()
        collector.join(allowed(20.0))
        assert not collector.is_alive()


def test_bags_are_identified_on_it(scheduler, certificate, tmp_path, capsys):
    write_recording(
        tmp_path / 'plant' / 'cell_7' / 'monday', recording_of(record(out_and_back(), seed=1), 'monday', 10**18)
    )
    told = ['--scheduler', scheduler, '--certificate', str(certificate), '--progress', 'none']
    assert identify_bag([str(tmp_path / 'plant'), '--each', '--output', str(tmp_path / 'out'), *told]) == 0
    assert (tmp_path / 'out' / 'cell_7' / 'monday' / 'report.json').exists()
    assert 'warning' not in capsys.readouterr().err


@pytest.mark.parametrize('damage', ['a passphrase', 'no key'])
def test_a_key_that_cannot_be_used_is_one_line(certificate, tmp_path, capfd, damage):
    shutil.copytree(certificate, tmp_path / 'own')
    key = tmp_path / 'own' / 'dask.key'
    if damage == 'a passphrase':
        private = load_pem_private_key(key.read_bytes(), None)
        key.write_bytes(private.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b'secret')))
    else:
        key.write_text('a key\n')
    with (
        pytest.raises(InputError, match='a certificate and its key without a passphrase'),
        existing_cluster('tls://127.0.0.1:1', tmp_path / 'own'),
    ):
        pass
    assert capfd.readouterr().err == ''


@pytest.mark.parametrize('address', ['', 'x', 'tcp://', 'host:port', 'tls://a b:1'])
def test_what_is_no_address_is_one_line(tmp_path, capsys, address):
    assert identify_bag(['b', '--each', '--scheduler', address, '--output', str(tmp_path / 'out')]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert 'argument --scheduler: give the address that the scheduler prints' in line


def test_a_certificate_that_is_none_is_a_line(scheduler, tmp_path, capsys):
    told = ['--scheduler', scheduler, '--certificate', str(tmp_path)]
    (tmp_path / 'bag').mkdir()
    assert identify_bag([str(tmp_path / 'bag'), *told, '--output', str(tmp_path / 'out')]) == 2
    assert identify_bag([str(tmp_path / 'bag'), '--certificate', '.', '--output', str(tmp_path / 'out')]) == 2
    assert '--certificate is for a cluster' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('address', 'open_to_others'),
    [
        ('tcp://10.0.0.7:8786', True),
        ('10.0.0.7:8786', True),
        ('tls://10.0.0.7:8786', False),
        ('tcp://127.0.0.1:8786', False),
        ('localhost:8786', False),
    ],
)
def test_a_scheduler_that_anybody_may_reach_is_known(address, open_to_others):
    assert is_open(address) == open_to_others
