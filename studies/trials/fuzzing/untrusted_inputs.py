# SPDX-License-Identifier: Apache-2.0
"""Try untrusted paths, message types, files of compiled code, and entries of output folders."""

from __future__ import annotations

import fcntl
import os
import shutil
import stat
import sys
import time
from contextlib import suppress
from pathlib import Path
from random import Random

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import ResultFiles, marked
from cfd_pneumatic.nodes import Folders, message_class
from cfd_pneumatic.runtime import LOCK_FILE, folder_lock, read_code, write_code
from studies.trials.fuzzing.campaign import Fault, Input, Kind
from studies.trials.fuzzing.mutators import BINARY, TEXTS, WORDS, mutated

_NEW = 'result of this run'
_FOREIGN_TEXT = 'result of another user'


class Paths(Kind):
    """Paths that `identifier_node` should read or write, among links, pipes and hidden files."""

    name = 'paths to identifier_node'
    _PARTS = ('inputs', 'outputs', 'elsewhere', 'bag', 'linked', 'inner', 'out', 'loop', '.hidden', 'key', '..', '.')

    def start(self, folder: Path) -> None:
        """Make the folders and their entries."""
        root = folder.resolve() / 'tree'
        for name in ('inputs/bag', 'inputs/linked', 'inputs/piped', 'inputs/.hidden', 'elsewhere', 'outputs/bag'):
            (root / name).mkdir(parents=True)
        for name in ('inputs/bag/x.mcap', 'inputs/table.csv', 'inputs/.hidden/key', 'elsewhere/key'):
            (root / name).touch()
        for name, target in (
            ('inputs/linked/key', '../../elsewhere/key'),
            ('inputs/inner', 'bag'),
            ('inputs/out', '../elsewhere'),
            ('inputs/loop', 'loop'),
            ('inputs/shown', '.hidden'),
            ('outputs/out', '..'),
        ):
            (root / name).symlink_to(target)
        os.mkfifo(root / 'inputs' / 'piped' / 'pipe')
        self._inputs, self._outputs = root / 'inputs', root / 'outputs'
        self._folders = Folders([str(self._inputs)], str(self._outputs))

    def valid(self, rng: Random) -> Input:
        """Return the path of a bag, a table or an output."""
        inputs = [self._inputs / name for name in ('bag', 'table.csv', 'inner', 'inner/x.mcap', '../inputs/bag')]
        outputs = [self._outputs / name for name in ('new', 'bag/a/b')]
        return Input({'path': os.fsencode(rng.choice(inputs + outputs))})

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return a path with changed parts."""
        parts = parent.files['path'].split(b'/')
        for _ in range(rng.choice((1, 1, 2, 4))):
            part = rng.choice(self._PARTS).encode() if rng.random() < 0.9 else rng.choice(TEXTS)
            begin = rng.randrange(1, len(parts) + 1)
            parts[begin : begin + rng.choice((0, 0, 1, 2))] = [part]
        return parent.changed('path', b'/'.join(parts))

    def give(self, case: Input) -> str:
        """Check that the node refuses to read or write outside its folders."""
        path = str(Path(os.fsdecode(case.files['path'])))  # as every reader does
        try:
            self._folders.check_readable(path)
        except InputError:
            self._folders.check_writable(path)
            if not _leads_below(path, self._outputs) or os.path.realpath(path) == str(self._outputs):
                raise Fault(f'{path} may be written') from None
            return 'may be written'
        inside = [os.path.join(top, name) for top, folders, files in os.walk(path) for name in folders + files]
        visible = [entry for entry in inside if '/.' not in entry.removeprefix(path)]
        for entry in [path, *visible]:
            try:
                kind = os.stat(entry).st_mode
            except OSError:  # FILE/.. does not exist for the system
                return 'cannot be opened'
            if not _leads_below(entry, self._inputs) or not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):
                raise Fault(f'{path} may be read, with {entry}')
        return 'may be read'

    def parses(self, case: Input) -> bool:
        """Return whether the input can be a path."""
        return b'\0' not in case.files['path']


def _leads_below(path: str, folder: Path) -> bool:
    """Return whether a path is below a folder and not in a hidden folder."""
    real = os.path.realpath(path)
    return f'{real}/'.startswith(f'{folder}/') and '/.' not in real.removeprefix(str(folder))


class TypeNames(Kind):
    """Message types of untrusted publishers; a type name must not import a module without messages."""

    name = 'types that are offered'
    _KNOWN = ('sensor_msgs/msg/JointState', 'std_msgs/msg/Float64', 'geometry_msgs/msg/WrenchStamped')

    def start(self, folder: Path) -> None:
        """Import the modules of known messages."""
        for name in (*self._KNOWN, 'std_msgs/msg/Unknown'):
            with suppress(InputError):
                message_class(name)
        self._modules = set(sys.modules)

    def valid(self, rng: Random) -> Input:
        """Return a type of ROS 2."""
        return Input({'type': rng.choice(self._KNOWN).encode()})

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return a changed name, sometimes of an installed module."""
        name = parent.files['type']
        if rng.random() < 0.3:
            name = name.replace(name.split(b'/')[0], rng.choice(('this', 'antigravity', 'idlelib', 'pip')).encode())
        return parent.changed('type', mutated(name, rng, WORDS))

    def give(self, case: Input) -> str:
        """Load the class of the type."""
        try:
            message_class(case.files['type'].decode(errors='replace'))
        finally:
            unexpected = [name for name in set(sys.modules) - self._modules if not name.split('.')[0].endswith('_msgs')]
            if unexpected:
                raise Fault(f'{unexpected} are imported')
        return ''

    def parses(self, case: Input) -> bool:
        """Return whether the name has three parts."""
        return case.files['type'].count(b'/') == 2


class CachedCode(Kind):
    """Files of the compile cache; a changed file must not be run."""

    name = 'files of the compile cache'

    def start(self, folder: Path) -> None:
        """Write a file of the cache."""
        self._path = folder / 'kept.nbc'
        self._content = bytes(range(256)) * 8
        write_code(self._path, self._content)
        self._written = self._path.read_bytes()

    def valid(self, rng: Random) -> Input:
        """Return the written file."""
        return Input({'kept.nbc': self._written})

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return the file with changed bytes, or as a different kind of entry."""
        if rng.random() < 0.2:
            return Input(parent.files, about=rng.choice(('a folder', 'a link', 'a pipe', 'open to all')), whole=False)
        return parent.changed('kept.nbc', mutated(parent.files['kept.nbc'], rng, BINARY))

    def give(self, case: Input) -> str:
        """Read the file."""
        self._make_entry(case)
        content = read_code(self._path)
        is_as_written = case.files['kept.nbc'] == self._written and case.about is None
        if content is not None and not (is_as_written and content == self._content):
            raise Fault(f'{case.about or "a changed file"} is run')
        if content is None:
            write_code(self._path, self._content)  # so that the next start finds the code
            if read_code(self._path) != self._content:
                raise Fault('the code is not written again')
            raise InputError('is compiled again')
        return ''

    def _make_entry(self, case: Input) -> None:
        if self._path.is_dir():
            shutil.rmtree(self._path)
        self._path.unlink(missing_ok=True)
        if case.about == 'a folder':
            self._path.mkdir()
        elif case.about == 'a link':
            self._path.symlink_to('elsewhere')
        elif case.about == 'a pipe':
            os.mkfifo(self._path)
        else:
            self._path.write_bytes(case.files['kept.nbc'])
            self._path.chmod(0o666 if case.about else 0o600)

    def parses(self, case: Input) -> bool:
        """Return whether the entry is a file."""
        return case.about in (None, 'open to all')


class CompilerLock(Kind):
    """Entries at the place of the compiler's lock; the compiler must neither wait nor change other files."""

    name = 'lock of the compiler'
    _KINDS = ('nothing', 'a file', 'a link to a file', 'a link to nowhere', 'a pipe', 'a folder', 'a loop')
    _LONGEST = 5.0  # [s]

    def start(self, folder: Path) -> None:
        """Make the cache and a file of another user."""
        self._lock, self._foreign = folder / 'cache' / LOCK_FILE, folder / 'foreign'
        self._lock.parent.mkdir()
        self._foreign.write_text(_FOREIGN_TEXT)
        self._foreign.chmod(0o644)

    def valid(self, rng: Random) -> Input:
        """Return the lock as an earlier start of the program makes it."""
        return Input({LOCK_FILE: b''}, about='a file 600')

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return an entry of any kind, with any content and permissions."""
        content = mutated(b'content of another program', rng, BINARY)
        return Input({LOCK_FILE: content}, about=f'{rng.choice(self._KINDS)} {rng.randrange(0o1000):o}', whole=False)

    def give(self, case: Input) -> str:
        """Lock the folder, and try to lock it again."""
        kind, _, mode = str(case.about).rpartition(' ')
        self._make_entry(kind, int(mode, 8), case.files[LOCK_FILE])
        begin = time.monotonic()
        with folder_lock(self._lock.parent):
            if time.monotonic() - begin > self._LONGEST:
                raise Fault(f'{case.about} makes the compiler wait')
            if kind in ('nothing', 'a file'):
                self._check_lock()
        if kind == 'a file' and self._lock.read_bytes() != case.files[LOCK_FILE]:
            raise Fault('the content of the file is lost')
        if self._foreign.read_text() != _FOREIGN_TEXT or stat.S_IMODE(self._foreign.stat().st_mode) != 0o644:
            raise Fault(f'{case.about} changes the file of another user')
        if kind not in ('nothing', 'a file'):
            raise InputError('is compiled without a lock')
        return ''

    def _make_entry(self, kind: str, mode: int, content: bytes) -> None:
        if self._lock.is_dir() and not self._lock.is_symlink():
            self._lock.rmdir()
        self._lock.unlink(missing_ok=True)
        if kind == 'a file':
            self._lock.write_bytes(content)
            self._lock.chmod(mode)
        elif kind == 'a pipe':
            os.mkfifo(self._lock, mode)
        elif kind == 'a folder':
            self._lock.mkdir()
        elif kind != 'nothing':
            targets = {'a link to a file': str(self._foreign), 'a link to nowhere': 'nowhere', 'a loop': LOCK_FILE}
            self._lock.symlink_to(targets[kind])

    def _check_lock(self) -> None:
        """Check that the lock is held, and that other users cannot open its file."""
        if stat.S_IMODE(self._lock.stat().st_mode) != 0o600:
            raise Fault('other users can lock the compiler')
        with self._lock.open('rb') as file, suppress(BlockingIOError):
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            raise Fault('two programs compile at the same time')

    def parses(self, case: Input) -> bool:
        """Return True: no parser reads the lock."""
        return True


class ResultFolders(Kind):
    """Output folders with files and links of other users; none of their files may be lost or written."""

    name = 'folders of results'
    _RESULTS = ResultFiles({'table.csv': marked('^result'), 'report.json': marked('^result')})
    _REMAINDER = '.out~abcdefgh'
    _NAMES = ('report.json', 'table.csv', 'notes', _REMAINDER, 'report.json~')
    _KINDS = ('result', 'mine', 'link', 'link to nowhere', 'pipe', 'folder', 'unreadable')

    def start(self, folder: Path) -> None:
        """Set the folder of the output folders, and write a file of another user."""
        self.top, self._mine = folder, folder / 'mine'
        self.folder = self.real = folder / 'out'
        self._mine.write_text(_FOREIGN_TEXT, encoding='utf-8')

    def valid(self, rng: Random) -> Input:
        """Return a folder with earlier results and sometimes a file of a user."""
        names = rng.sample(('report.json', 'table.csv', 'notes'), rng.randrange(4))
        return folder_of({name: 'mine' if name == 'notes' else 'result' for name in names})

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return the folder with changed entries."""
        entries = {rng.choice(self._NAMES): rng.choice(self._KINDS) for _ in range(rng.choice((1, 1, 2, 4)))}
        if entries.get(self._REMAINDER) == 'folder':  # a killed run leaves such a folder
            del entries[self._REMAINDER]
        return Input(folder_of(parent.about | entries).files, parent.about | entries, whole=False)

    def give(self, case: Input) -> str:
        """Write results into the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir()
        self.fill(self.folder, case)
        self.write(case)
        return ''

    def fill(self, folder: Path, case: Input) -> None:
        """Make the entries of the folder."""
        for name, kind in case.about.items():
            self._make_entry(folder / name, kind)

    def write(self, case: Input) -> None:
        """Write results, and check that all other entries are unchanged."""
        foreign, surroundings, earlier = self._foreign_entries(case), self._surroundings(), self._results()
        try:
            self._RESULTS.check(self.folder, overwrite=False)
            with self._RESULTS.made_for(self.folder, overwrite=False) as target:
                (target / 'report.json').write_text(_NEW, encoding='utf-8')
        except InputError:
            if self._results() != earlier:
                raise Fault('the results are refused, and earlier ones are lost') from None
            raise
        else:
            if self._results() != {'report.json': _NEW}:
                raise Fault('the results in the folder differ from the written results')
        finally:
            if self._foreign_entries(case) != foreign or self._mine.read_text(encoding='utf-8') != _FOREIGN_TEXT:
                raise Fault('a file of another user is lost or written')
            if self._surroundings() != surroundings:
                raise Fault('a temporary entry remains next to the folder')

    def _surroundings(self) -> set[Path]:
        """Return all entries outside the output folder, without its parents."""
        known, inside = (self.folder, *self.folder.parents), {self.folder, self.real}
        return {path for path in self.top.rglob('*') if path not in known and not inside.intersection(path.parents)}

    def _results(self) -> dict[str, str] | None:
        """Return the content of each result in the folder, by name; None without a folder."""
        if not self.folder.is_dir():
            return None
        results = [path for path in self.folder.iterdir() if self._RESULTS.is_earlier(path)]
        return {path.name: path.read_text(encoding='utf-8') for path in results}

    def _make_entry(self, path: Path, kind: str) -> None:
        if kind.startswith('link'):
            path.symlink_to('nowhere' if 'nowhere' in kind else self._mine)
        elif kind == 'pipe':
            os.mkfifo(path)
        elif kind == 'folder':
            path.mkdir()
            (path / 'inside').touch()
        else:
            path.write_text('result' if kind == 'result' else 'mine', encoding='utf-8')
            path.chmod(0o000 if kind == 'unreadable' else 0o644)

    def _foreign_entries(self, case: Input) -> dict[str, int]:
        """Return the inode of each entry that is not an earlier result."""
        kept = [name for name, kind in case.about.items() if kind != 'result' or name == 'notes']
        return {name: (self.folder / name).lstat().st_ino for name in kept if os.path.lexists(self.folder / name)}

    def parses(self, case: Input) -> bool:
        """Return whether no entry has the name of a result."""
        return not {'report.json', 'table.csv'} & case.about.keys()


def folder_of(entries: dict[str, str]) -> Input:
    """Return a folder as an input, given the kinds of its entries by name."""
    return Input({'entries': repr(entries).encode()}, entries)


def kinds() -> list[Kind]:
    """Return all kinds of untrusted inputs."""
    return [Paths(), TypeNames(), CachedCode(), CompilerLock(), ResultFolders()]
