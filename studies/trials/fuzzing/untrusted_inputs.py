# SPDX-License-Identifier: Apache-2.0
"""What strangers may name or leave behind: paths, types of messages, compiled code, entries of output folders."""

from __future__ import annotations

import os
import shutil
import stat
import sys
from contextlib import suppress
from pathlib import Path
from random import Random

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.files import ResultFiles, marked
from cfd_pneumatic.nodes import Folders, message_class
from cfd_pneumatic.runtime import read_code, write_code
from studies.trials.fuzzing.campaign import Fault, Input, Kind
from studies.trials.fuzzing.mutators import BINARY, TEXTS, WORDS, mutated

_NEW = 'result of this run'


class Paths(Kind):
    """Paths that `identifier_node` is told to read or write, among links, pipes and hidden files."""

    name = 'paths to identifier_node'
    _PARTS = ('inputs', 'outputs', 'elsewhere', 'bag', 'linked', 'inner', 'out', 'loop', '.hidden', 'key', '..', '.')

    def start(self, folder: Path) -> None:
        """Make the folders and what is in them."""
        root = folder.resolve() / 'tree'
        for one in ('inputs/bag', 'inputs/linked', 'inputs/piped', 'inputs/.hidden', 'elsewhere', 'outputs/bag'):
            (root / one).mkdir(parents=True)
        for one in ('inputs/bag/x.mcap', 'inputs/table.csv', 'inputs/.hidden/key', 'elsewhere/key'):
            (root / one).touch()
        for one, to in (
            ('inputs/linked/key', '../../elsewhere/key'),
            ('inputs/inner', 'bag'),
            ('inputs/out', '../elsewhere'),
            ('inputs/loop', 'loop'),
            ('inputs/shown', '.hidden'),
            ('outputs/out', '..'),
        ):
            (root / one).symlink_to(to)
        os.mkfifo(root / 'inputs' / 'piped' / 'pipe')
        self._inputs, self._outputs = root / 'inputs', root / 'outputs'
        self._folders = Folders([str(self._inputs)], str(self._outputs))

    def valid(self, rng: Random) -> Input:
        """Return the path of a bag, a table or an output."""
        inputs = [self._inputs / one for one in ('bag', 'table.csv', 'inner', 'inner/x.mcap', '../inputs/bag')]
        outputs = [self._outputs / one for one in ('new', 'bag/a/b')]
        return Input({'path': os.fsencode(rng.choice(inputs + outputs))})

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return it with other parts."""
        parts = parent.files['path'].split(b'/')
        for _ in range(rng.choice((1, 1, 2, 4))):
            part = rng.choice(self._PARTS).encode() if rng.random() < 0.9 else rng.choice(TEXTS)
            begin = rng.randrange(1, len(parts) + 1)
            parts[begin : begin + rng.choice((0, 0, 1, 2))] = [part]
        return parent.changed('path', b'/'.join(parts))

    def give(self, one: Input) -> str:
        """Ask whether it may be read or written."""
        path = str(Path(os.fsdecode(one.files['path'])))  # as every reader takes it
        try:
            self._folders.check_readable(path)
        except InputError:
            self._folders.check_writable(path)
            if not _leads_below(path, self._outputs) or os.path.realpath(path) == str(self._outputs):
                raise Fault(f'{path} may be written') from None
            return 'may be written'
        found = [path, *(os.path.join(top, name) for top, folders, files in os.walk(path) for name in folders + files)]
        shown = [one for one in found[1:] if '/.' not in one.removeprefix(path)]
        for one_path in [path, *shown]:
            try:
                kind = os.stat(one_path).st_mode
            except OSError:  # FILE/.. is none for the system
                return 'cannot be opened'
            if not _leads_below(one_path, self._inputs) or not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):
                raise Fault(f'{path} may be read, with {one_path}')
        return 'may be read'

    def parses(self, one: Input) -> bool:
        """Return whether it can be a path."""
        return b'\0' not in one.files['path']


def _leads_below(path: str, folder: Path) -> bool:
    """Return whether a path leads below a folder, on a way without hidden folders."""
    real = os.path.realpath(path)
    return f'{real}/'.startswith(f'{folder}/') and '/.' not in real.removeprefix(str(folder))


class TypeNames(Kind):
    """Types of messages that a stranger offers, of which none may import what is no message."""

    name = 'types that are offered'
    _KNOWN = ('sensor_msgs/msg/JointState', 'std_msgs/msg/Float64', 'geometry_msgs/msg/WrenchStamped')

    def start(self, folder: Path) -> None:
        """Import what messages need."""
        for name in (*self._KNOWN, 'std_msgs/msg/Unknown'):
            with suppress(InputError):
                message_class(name)
        self._modules = set(sys.modules)

    def valid(self, rng: Random) -> Input:
        """Return a type of ROS 2."""
        return Input({'type': rng.choice(self._KNOWN).encode()})

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return another name, perhaps of a module that there is."""
        name = parent.files['type']
        if rng.random() < 0.3:
            name = name.replace(name.split(b'/')[0], rng.choice(('this', 'antigravity', 'idlelib', 'pip')).encode())
        return parent.changed('type', mutated(name, rng, WORDS))

    def give(self, one: Input) -> str:
        """Ask for its class."""
        try:
            message_class(one.files['type'].decode(errors='replace'))
        finally:
            strange = [name for name in set(sys.modules) - self._modules if not name.split('.')[0].endswith('_msgs')]
            if strange:
                raise Fault(f'{strange} are imported')
        return ''

    def parses(self, one: Input) -> bool:
        """Return whether it has the parts of a name."""
        return one.files['type'].count(b'/') == 2


class KeptCode(Kind):
    """Files of the compile cache: what is not as it was written must not be run."""

    name = 'files of the compile cache'

    def start(self, folder: Path) -> None:
        """Write one."""
        self._path = folder / 'kept.nbc'
        self._content = bytes(range(256)) * 8
        write_code(self._path, self._content)
        self._written = self._path.read_bytes()

    def valid(self, rng: Random) -> Input:
        """Return what was written."""
        return Input({'kept.nbc': self._written})

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return it with other bytes, or in another form."""
        if rng.random() < 0.2:
            return Input(parent.files, about=rng.choice(('a folder', 'a link', 'a pipe', 'open to all')), whole=False)
        return parent.changed('kept.nbc', mutated(parent.files['kept.nbc'], rng, BINARY))

    def give(self, one: Input) -> str:
        """Let it be read."""
        self._leave(one)
        content = read_code(self._path)
        is_as_written = one.files['kept.nbc'] == self._written and one.about is None
        if content is not None and not (is_as_written and content == self._content):
            raise Fault(f'{one.about or "what was changed"} is run')
        if content is None:
            write_code(self._path, self._content)  # the next start has it again
            if read_code(self._path) != self._content:
                raise Fault('it is not kept again')
            raise InputError('is compiled again')
        return ''

    def _leave(self, one: Input) -> None:
        if self._path.is_dir():
            shutil.rmtree(self._path)
        self._path.unlink(missing_ok=True)
        if one.about == 'a folder':
            self._path.mkdir()
        elif one.about == 'a link':
            self._path.symlink_to('elsewhere')
        elif one.about == 'a pipe':
            os.mkfifo(self._path)
        else:
            self._path.write_bytes(one.files['kept.nbc'])
            self._path.chmod(0o666 if one.about else 0o600)

    def parses(self, one: Input) -> bool:
        """Return whether it is a file."""
        return one.about in (None, 'open to all')


class ResultFolders(Kind):
    """Output folders in which others left files and links: no file of theirs may be lost or written."""

    name = 'folders of results'
    _RESULTS = ResultFiles({'table.csv': marked('^result'), 'report.json': marked('^result')})
    _LEFT = '.out~abcdefgh'
    _NAMES = ('report.json', 'table.csv', 'notes', _LEFT, 'report.json~')
    _KINDS = ('result', 'mine', 'link', 'link to nowhere', 'pipe', 'folder', 'unreadable')

    def start(self, folder: Path) -> None:
        """Note where the folders are made."""
        self.top, self._mine = folder, folder / 'mine'
        self.folder = self.real = folder / 'out'
        self._mine.write_text('result of somebody else', encoding='utf-8')

    def valid(self, rng: Random) -> Input:
        """Return a folder that holds earlier results and a file of another name."""
        names = rng.sample(('report.json', 'table.csv', 'notes'), rng.randrange(4))
        return folder_of({name: 'mine' if name == 'notes' else 'result' for name in names})

    def changed(self, parent: Input, rng: Random) -> Input:
        """Return the folder with other entries."""
        more = {rng.choice(self._NAMES): rng.choice(self._KINDS) for _ in range(rng.choice((1, 1, 2, 4)))}
        if more.get(self._LEFT) == 'folder':  # as a run that was killed leaves one
            del more[self._LEFT]
        return Input(folder_of(parent.about | more).files, parent.about | more, whole=False)

    def give(self, one: Input) -> str:
        """Write results into the folder."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir()
        self.fill(self.folder, one)
        self.write(one)
        return ''

    def fill(self, folder: Path, one: Input) -> None:
        """Make what is in the folder."""
        for name, kind in one.about.items():
            self._leave(folder / name, kind)

    def write(self, one: Input) -> None:
        """Write results, and compare what is there with what was there before."""
        others, around, earlier = self._of_others(one), self._around(), self._results()
        try:
            self._RESULTS.check(self.folder, overwrite=False)
            with self._RESULTS.made_for(self.folder, overwrite=False) as made:
                (made / 'report.json').write_text(_NEW, encoding='utf-8')
        except InputError:
            if self._results() != earlier:
                raise Fault('the results are refused, and earlier ones are lost') from None
            raise
        else:
            if self._results() != {'report.json': _NEW}:
                raise Fault('the folder holds other results than those that were written')
        finally:
            if self._of_others(one) != others or self._mine.read_text(encoding='utf-8') != 'result of somebody else':
                raise Fault('a file of somebody else is lost or written')
            if self._around() != around:
                raise Fault('something is left next to the folder')

    def _around(self) -> set[Path]:
        """Return what there is in addition to the folder, what is inside, and the folders above."""
        known, inside = (self.folder, *self.folder.parents), {self.folder, self.real}
        return {path for path in self.top.rglob('*') if path not in known and not inside.intersection(path.parents)}

    def _results(self) -> dict[str, str] | None:
        """Return the content of each result in the folder, by name; None without a folder."""
        if not self.folder.is_dir():
            return None
        found = [path for path in self.folder.iterdir() if self._RESULTS.is_earlier(path)]
        return {path.name: path.read_text(encoding='utf-8') for path in found}

    def _leave(self, path: Path, kind: str) -> None:
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

    def _of_others(self, one: Input) -> dict[str, int]:
        """Return the inode of each entry that is not an earlier result."""
        kept = [name for name, kind in one.about.items() if kind != 'result' or name == 'notes']
        return {name: (self.folder / name).lstat().st_ino for name in kept if os.path.lexists(self.folder / name)}

    def parses(self, one: Input) -> bool:
        """Return whether no entry has the name of a result."""
        return not {'report.json', 'table.csv'} & one.about.keys()


def folder_of(entries: dict[str, str]) -> Input:
    """Return a folder whose entries are known by name and kind."""
    return Input({'entries': repr(entries).encode()}, entries)


def kinds() -> list[Kind]:
    """Return all kinds of what strangers name or leave behind."""
    return [Paths(), TypeNames(), KeptCode(), ResultFolders()]
