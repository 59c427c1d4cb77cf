# SPDX-License-Identifier: Apache-2.0
"""Control a headless Chromium over its debugging pipe, with the standard library alone."""

from __future__ import annotations

import base64
import fcntl
import itertools
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

PROGRAM = next((path for name in ('chromium', 'chromium-browser', 'google-chrome') if (path := shutil.which(name))), '')
"""Path of the browser; empty if none is installed."""

_PATIENCE = 60.0  # [s]
_POLL = 0.05  # [s]
_FLAGS = (
    '--headless=new',
    '--no-sandbox',
    '--disable-gpu',
    '--disable-dev-shm-usage',
    '--disable-background-networking',
    '--no-first-run',
    '--hide-scrollbars',
    '--remote-debugging-pipe',
)


class Chromium:
    """A browser with one tab; the end of the context ends the browser."""

    def __init__(self) -> None:
        self._home = tempfile.mkdtemp(prefix='chromium.')
        browser_input, self._to = os.pipe()
        self._from, browser_output = os.pipe()
        # the browser reads its descriptor 3 and writes 4
        ends = [fcntl.fcntl(end, fcntl.F_DUPFD, 10) for end in (browser_input, browser_output)]
        self._process = subprocess.Popen(
            [PROGRAM, *_FLAGS, f'--user-data-dir={self._home}', 'about:blank'],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={**os.environ, 'TMPDIR': self._home},
            close_fds=False,  # the browser inherits the two descriptors; Python's own close on exec
            preexec_fn=lambda: [os.dup2(end, number) for end, number in zip(ends, (3, 4))],
            start_new_session=True,
        )
        for end in (browser_input, browser_output, *ends):
            os.close(end)
        self._numbers = itertools.count(1)
        self._buffer = b''
        self._session = ''
        self.events: list[dict[str, Any]] = []
        target = self.call('Target.createTarget', url='about:blank')['targetId']
        self._session = self.call('Target.attachToTarget', targetId=target, flatten=True)['sessionId']
        for domain in ('Page', 'Runtime', 'Log', 'Network'):
            self.call(f'{domain}.enable')

    def __enter__(self) -> Chromium:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        for end in (self._to, self._from):
            os.close(end)
        shutil.rmtree(self._home, ignore_errors=True)

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Return the answer of the DevTools protocol to a method."""
        number = next(self._numbers)
        message: dict[str, Any] = {'id': number, 'method': method, 'params': parameters}
        if self._session:
            message['sessionId'] = self._session
        os.write(self._to, json.dumps(message).encode() + b'\0')
        while True:
            answer = self._message()
            if answer.get('id') == number:
                assert 'error' not in answer, (method, answer['error'])
                return answer['result']
            self.events.append(answer)

    def _message(self) -> dict[str, Any]:
        limit = time.monotonic() + _PATIENCE
        while b'\0' not in self._buffer:
            ready, _, _ = select.select([self._from], [], [], max(limit - time.monotonic(), 0.0))
            assert ready, f'Chromium did not answer within {_PATIENCE} s'
            chunk = os.read(self._from, 1 << 16)
            assert chunk, 'Chromium has ended'
            self._buffer += chunk
        message, _, self._buffer = self._buffer.partition(b'\0')
        return json.loads(message)

    def show(self, page: Path, width: int, height: int, *, dark: bool = False) -> None:
        """Open a page in a window of a size [CSS px] and wait until the page is loaded."""
        mobile = width < 600
        size = {'width': width, 'height': height, 'deviceScaleFactor': 2 if mobile else 1, 'mobile': mobile}
        self.call('Emulation.setDeviceMetricsOverride', **size)
        scheme = {'name': 'prefers-color-scheme', 'value': 'dark' if dark else 'light'}
        self.call('Emulation.setEmulatedMedia', features=[scheme])
        self.events.clear()
        self.call('Page.navigate', url=page.resolve().as_uri())
        while not any(event.get('method') == 'Page.loadEventFired' for event in self.events):
            self.events.append(self._message())

    def value(self, expression: str) -> Any:
        """Return the value of an expression of JavaScript."""
        result = self.call('Runtime.evaluate', expression=expression, returnByValue=True)
        assert 'exceptionDetails' not in result, result
        return result['result'].get('value')

    def result(self, expression: str) -> Any:
        """Return the result of a promise of JavaScript."""
        result = self.call('Runtime.evaluate', expression=expression, returnByValue=True, awaitPromise=True)
        assert 'exceptionDetails' not in result, result
        return result['result'].get('value')

    def wait_for(self, condition: str) -> None:
        """Wait until an expression of JavaScript is true."""
        limit = time.monotonic() + _PATIENCE
        while not self.value(condition):
            assert time.monotonic() < limit, f'{condition} did not become true within {_PATIENCE} s'
            time.sleep(_POLL)

    def press(self, key: str) -> None:
        """Press and release a key, and wait for the next picture of the page."""
        for kind in ('keyDown', 'keyUp'):
            self.call('Input.dispatchKeyEvent', type=kind, key=key)
        self.result('new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))')

    def heard(self, *methods: str) -> list[Mapping[str, Any]]:
        """Return the parameters of the events with these methods since the page was opened."""
        return [event['params'] for event in self.events if event.get('method') in methods]

    def screenshot(self) -> bytes:
        """Return a PNG picture of the visible part of the page."""
        return base64.b64decode(self.call('Page.captureScreenshot')['data'])

    def pdf(self) -> bytes:
        """Return the printed page as PDF."""
        return base64.b64decode(self.call('Page.printToPDF', preferCSSPageSize=True, printBackground=False)['data'])
