"""Files and folders that appear whole or not at all: written beside their places and, once all are written, moved there.

Where the system can (O_TMPFILE), a file has no name before it is whole. Else, and for the moment in which it takes another's place, it
is called `.urdfcal-<random>.part`; its writer holds a lock on it, so that what a killed one left is known, and swept away by the next.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
import secrets
import shutil
import stat
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from urdfcal.base.errors import UsageError

_PART = re.compile(r"\.urdfcal-[0-9a-f]{16}\.part")
_CANNOT = (errno.EOPNOTSUPP, errno.EISDIR, errno.EINVAL, errno.ENOENT)  # what systems without unnamed files answer
_KINDS = {stat.S_ISFIFO: "a pipe", stat.S_ISCHR: "a device", stat.S_ISBLK: "a device", stat.S_ISSOCK: "a socket"}


def write_whole(path: str | Path, content: bytes) -> None:
    """Write a file beside its place and move it there.

    Raises:
        UsageError: the place cannot be written to.
    """
    write_together({path: content})


def write_together(contents: Mapping[str | Path, bytes]) -> None:
    """Write several files beside their places and, once all are written, move them there in their order.

    Links are followed and stay; a file that is replaced gives its mode to the new one. What belongs to the others and tells of them
    comes last: should the move be cut short, it tells that they are not its own.

    Raises:
        UsageError: a place cannot be written to; no file has been touched then.
    """
    with contextlib.ExitStack() as parts:
        waiting = {Path(path): parts.enter_context(_part(Path(path), content)) for path, content in contents.items()}
        for path, part in waiting.items():
            try:
                part.move()
            except OSError as error:
                raise _unwritable(path, error) from None


@contextlib.contextmanager
def folder_whole(path: str | Path) -> Iterator[Path]:
    """A folder to fill, beside its place; left without an error, it is moved there.

    Raises:
        UsageError: the place cannot be a new folder.
    """
    path = Path(path)
    require_new_folder(path)
    target = Path(os.path.realpath(path))
    try:
        sweep(target.parent)
        beside, descriptor = _part_folder(target.parent)
    except OSError as error:
        raise _unwritable(path, error) from None
    try:
        yield beside
        if target.is_dir():
            beside.chmod(stat.S_IMODE(target.stat().st_mode))
        beside.rename(target)
    except OSError as error:
        raise _unwritable(path, error) from None
    finally:
        os.close(descriptor)
        shutil.rmtree(beside, ignore_errors=True)


def _part_folder(above: Path) -> tuple[Path, int]:
    """A new folder that nobody sweeps away, and what holds it so: one that is swept before it is locked gives way to another."""
    while True:
        beside = above / _part_name()
        beside.mkdir()
        with contextlib.suppress(FileNotFoundError):
            descriptor = os.open(beside, os.O_RDONLY)
            if _lock(descriptor) and beside.is_dir():
                return beside, descriptor
            os.close(descriptor)


def make_folders(folders: Iterable[Path]) -> None:
    """Make folders that are not there yet, and those above them.

    Raises:
        UsageError: one cannot be made.
    """
    for folder in folders:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise _unwritable(folder, error) from None


def require_writable(path: str | Path) -> None:
    """Refuse a place that cannot be written to, before any work is done for it.

    Raises:
        UsageError: the folder is missing or closed to us, or the path is a folder, a device, a pipe or read-only.
    """
    path = Path(path)
    folder = _target(path).parent
    if not folder.is_dir():
        raise UsageError(f"{path}: the folder {folder if path.is_symlink() else path.parent} does not exist")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UsageError(f"{path}: the folder {path.parent} cannot be written to")
    try:
        longest = os.pathconf(folder, "PC_NAME_MAX")
    except OSError:  # a file system that does not say
        return
    if len(os.fsencode(path.name)) > longest:
        raise UsageError(f"{path}: the name is longer than {longest} bytes")


def require_new_folder(path: Path) -> None:
    """Refuse a place that cannot be a new folder, before any work is done for it.

    Raises:
        UsageError: it is a file, holds something already, or is in a folder that is missing or closed to us.
    """
    try:
        if path.is_dir():
            if any(not _PART.fullmatch(inside.name) for inside in path.iterdir()):
                raise UsageError(f"{path}: is not empty; name a new folder, so that nothing of another run stays among what is new")
            if os.path.ismount(path):
                raise UsageError(f"{path}: is where a file system is mounted; name a new folder in it")
        elif os.path.lexists(path):
            raise UsageError(f"{path}: is a file, expected a folder")
        folder = Path(os.path.realpath(path)).parent
        if not folder.is_dir():
            raise UsageError(f"{path}: the folder {path.parent} does not exist")
        if not os.access(folder, os.W_OK | os.X_OK):
            raise UsageError(f"{path}: the folder {path.parent} cannot be written to")
    except OSError as error:
        raise _unwritable(path, error) from None


def sweep(folder: Path) -> None:
    """Take away what writers that were killed have left in a folder; what another is at work on is locked, and stays."""
    for left in [folder / name for name in os.listdir(folder) if _PART.fullmatch(name)]:
        with contextlib.suppress(OSError):  # somebody else's, or gone by now
            descriptor = os.open(left, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                shutil.rmtree(left) if left.is_dir() else left.unlink()
            finally:
                os.close(descriptor)


class _Part:
    """A file that is being written, without a name where the system has such files."""

    def __init__(self, target: Path) -> None:
        self.target, self.name = target, None if _unnamed_files() else target.parent / _part_name()
        self.descriptor = self._opened()
        while not _lock(self.descriptor) or not (self.name is None or self.name.exists()):  # swept by another before it was locked
            os.close(self.descriptor)
            self.name = target.parent / _part_name()
            self.descriptor = self._opened()

    def _opened(self) -> int:
        if self.name is None:
            try:
                return os.open(self.target.parent, os.O_TMPFILE | os.O_WRONLY, 0o666)
            except OSError as error:
                if error.errno not in _CANNOT:
                    raise
                self.name = self.target.parent / _part_name()
        return os.open(self.name, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666)

    def write(self, content: bytes) -> None:
        """Fill it, with the mode and owner of what it will replace."""
        if self.target.exists():
            before = self.target.stat()
            with contextlib.suppress(PermissionError):  # only root gives files away
                os.fchown(self.descriptor, before.st_uid, before.st_gid)
            os.fchmod(self.descriptor, stat.S_IMODE(before.st_mode) & 0o777)
        with os.fdopen(os.dup(self.descriptor), "wb") as stream:
            stream.write(content)
        os.fsync(self.descriptor)

    def move(self) -> None:
        """Put it in its place."""
        if self.name is None and not self.target.exists():
            with contextlib.suppress(FileExistsError):  # another came first: replace that
                self._link(self.target)
                return
        if self.name is None:
            name = self.target.parent / _part_name()
            self._link(name)
            self.name = name
        os.replace(self.name, self.target)
        self.name = None

    def _link(self, place: Path) -> None:
        os.link(f"/proc/self/fd/{self.descriptor}", place, src_dir_fd=self.descriptor)  # with a dir_fd, links are followed

    def close(self) -> None:
        """Give it up, unless it is in its place."""
        if self.name is not None:
            with contextlib.suppress(OSError):
                self.name.unlink()
        os.close(self.descriptor)


@contextlib.contextmanager
def _part(path: Path, content: bytes) -> Iterator[_Part]:
    target = _target(path)
    try:
        sweep(target.parent)
        part = _Part(target)
    except OSError as error:
        raise _unwritable(path, error) from None
    try:
        try:
            part.write(content)
        except OSError as error:
            raise _unwritable(path, error) from None
        yield part
    finally:
        part.close()


def _target(path: Path) -> Path:
    """The file, there or not, that a path leads to.

    Raises:
        UsageError: it is none, or closed to us.
    """
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        return Path(os.path.realpath(path))
    except OSError as error:
        raise _unwritable(path, error) from None
    if stat.S_ISDIR(mode):
        raise UsageError(f"{path}: is a folder, expected a file name")
    if not stat.S_ISREG(mode):
        kind = next((name for test, name in _KINDS.items() if test(mode)), "no file")
        raise UsageError(f"{path}: is {kind}, expected a file name (- is standard output)")
    if not mode & 0o222 or not os.access(path, os.W_OK):
        raise UsageError(f"{path}: is read-only; name another file, or allow it with chmod u+w")
    return Path(os.path.realpath(path))


def _unnamed_files() -> bool:
    return hasattr(os, "O_TMPFILE") and os.path.isdir("/proc/self/fd")


def _part_name() -> str:
    return f".urdfcal-{secrets.token_hex(8)}.part"


def _lock(descriptor: int) -> bool:
    """Lock what is begun; False where another has, who sweeps it away."""
    with contextlib.suppress(OSError):  # a file system without locks: nobody else can lock, and sweep, it either
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True


def _unwritable(path: Path, error: OSError) -> UsageError:
    return UsageError(f"{path}: cannot be written: {error.strerror or error}")
