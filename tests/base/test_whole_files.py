"""Files and folders appear whole or not at all, where they belong and nowhere else, and leave nothing beside them."""

from __future__ import annotations

import fcntl
import os
import socket
import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from urdfcal.base import whole_files
from urdfcal.base.errors import UsageError
from urdfcal.base.opened import begin, opened, reads, unnoted
from urdfcal.base.whole_files import folder_whole, require_new_folder, require_writable, write_together, write_whole


@pytest.fixture(params=[True, False], ids=["unnamed", "named"])
def system(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """A system that has files without names, and one that has not."""
    if not request.param:
        monkeypatch.setattr(whole_files, "_unnamed_files", lambda: False)


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


@pytest.mark.usefixtures("system")
def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    """Writing replaces a file, with the permissions that a new file has, and leaves nothing beside it."""
    for content in (b"old", b"new\r\n\x00"):
        write_whole(tmp_path / "a", content)
    (tmp_path / "b").touch()
    assert (tmp_path / "a").read_bytes() == b"new\r\n\x00"
    assert mode(tmp_path / "a") == mode(tmp_path / "b")
    assert sorted(os.listdir(tmp_path)) == ["a", "b"]


@pytest.mark.usefixtures("system")
@pytest.mark.parametrize("permissions", [0o600, 0o640, 0o755])
def test_the_mode_of_a_replaced_file_stays(permissions: int, tmp_path: Path) -> None:
    """What was private stays private."""
    (tmp_path / "a").write_bytes(b"old")
    (tmp_path / "a").chmod(permissions)
    write_whole(tmp_path / "a", b"new")
    assert (mode(tmp_path / "a"), (tmp_path / "a").read_bytes()) == (permissions, b"new")


@pytest.mark.usefixtures("system")
@pytest.mark.parametrize("there", [True, False], ids=["file", "dangling"])
def test_links_are_followed_and_stay(there: bool, tmp_path: Path) -> None:
    """What a link, or a link to it, leads to is written, in its own folder, and the links are left."""
    (tmp_path / "there").mkdir()
    target = tmp_path / "there" / "a"
    if there:
        target.write_bytes(b"old")
    (tmp_path / "one").symlink_to("there/a")
    (tmp_path / "two").symlink_to("one")
    require_writable(tmp_path / "two")
    write_whole(tmp_path / "two", b"new")
    assert (target.read_bytes(), target.is_symlink()) == (b"new", False)
    assert (os.readlink(tmp_path / "two"), os.readlink(tmp_path / "one")) == ("one", "there/a")
    assert os.listdir(tmp_path / "there") == ["a"]


def a_pipe(path: Path) -> None:
    os.mkfifo(path)


def a_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as unix:
        unix.bind(str(path))


def read_only(path: Path) -> None:
    path.touch(0o444)


def to_a_device(path: Path) -> None:
    path.symlink_to("/dev/null")


def to_itself(path: Path) -> None:
    path.symlink_to(path)


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (Path.mkdir, "is a folder, expected a file name"),
        (a_pipe, "is a pipe, expected a file name"),
        (a_socket, "is a socket, expected a file name"),
        (to_a_device, "is a device, expected a file name"),
        (to_itself, "cannot be written: Too many levels"),
        (read_only, "is read-only; name another file, or allow it with chmod"),
    ],
)
def test_what_is_no_file_of_the_users_stays(made: Callable[[Path], object], words: str, tmp_path: Path) -> None:
    """Folders, pipes, sockets, devices, circles and read-only files are refused by name, before any work and at the writing, and stay."""
    place = tmp_path / "a"
    made(place)
    before = place.lstat()
    for write in (require_writable, lambda path: write_whole(path, b"new")):
        with pytest.raises(UsageError, match=f"{place}: {words}"):
            write(place)
    assert (place.lstat().st_ino, place.lstat().st_mode) == (before.st_ino, before.st_mode)
    assert os.listdir(tmp_path) == ["a"]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("nope/a", "the folder .*nope does not exist"),
        ("x" * 300, "the name is longer than 255 bytes|File name too long"),
        ("ä" * 200, "the name is longer than 255 bytes|File name too long"),
        ("file/a", "cannot be written: Not a directory"),
    ],
)
def test_places_that_cannot_be_are_refused(name: str, words: str, tmp_path: Path) -> None:
    """A missing folder, a name too long and a file that is taken for a folder are one line each."""
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match=words):
        require_writable(tmp_path / name)


@pytest.mark.usefixtures("system")
def test_of_several_files_none_is_written_if_one_cannot_be(tmp_path: Path) -> None:
    """When the second file has no place, the first stays as it was and nothing is left behind."""
    (tmp_path / "a").write_bytes(b"old")
    (tmp_path / "folder").mkdir()
    for wrong in (tmp_path / "nope" / "b", tmp_path / "folder"):
        with pytest.raises(UsageError, match=f"{wrong}: "):
            write_together({tmp_path / "a": b"new", wrong: b"new"})
    assert (tmp_path / "a").read_bytes() == b"old"
    assert sorted(os.listdir(tmp_path)) == ["a", "folder"]


@pytest.mark.usefixtures("system")
def test_names_as_long_as_can_be_are_written(tmp_path: Path) -> None:
    """What a file is called on the way is no longer than any name."""
    for _ in range(2):
        write_whole(tmp_path / ("x" * 255), b"new")
    assert os.listdir(tmp_path) == ["x" * 255]


def test_what_a_killed_writer_left_is_swept(tmp_path: Path) -> None:
    """Parts that nobody is at work on go with the next writing; one that is locked stays, and so does what only looks like one."""
    left, folder, busy, other = (
        tmp_path / name
        for name in (f".urdfcal-{'0' * 16}.part", f".urdfcal-{'1' * 16}.part", f".urdfcal-{'2' * 16}.part", ".urdfcal-x.part")
    )
    for path in (left, busy, other):
        path.touch()
    folder.mkdir()
    (folder / "picture.png").touch()
    with busy.open() as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        write_whole(tmp_path / "a", b"new")
    assert {path.name for path in tmp_path.iterdir()} == {"a", busy.name, other.name}


@pytest.mark.usefixtures("system")
def test_what_another_begins_is_not_swept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another writer that comes between the making of a part and its lock takes it away, or is about to: a new one is made."""
    lock, came = whole_files._lock, list[str]()

    def met(descriptor: int) -> bool:
        if len(came) % 3 == 0:
            whole_files.sweep(tmp_path)
        came.append("")
        return len(came) % 3 != 2 and lock(descriptor)

    monkeypatch.setattr(whole_files, "_lock", met)
    write_whole(tmp_path / "a", b"new")
    with folder_whole(tmp_path / "b") as folder:
        write_whole(folder / "x", b"x")
    whole_files.sweep(tmp_path)
    assert (tmp_path / "a").read_bytes() == b"new"
    assert sorted(os.listdir(tmp_path)) == ["a", "b"]
    assert os.listdir(tmp_path / "b") == ["x"]


def test_a_folder_appears_whole(tmp_path: Path) -> None:
    """Nothing stands at its place before all of it does; an empty folder there gives way and keeps its mode."""
    (tmp_path / "b").mkdir(0o700)
    for name in ("a", "b"):
        with folder_whole(tmp_path / name) as folder:
            (folder / "x").write_bytes(b"x")
            assert not (tmp_path / name / "x").exists()
        assert (tmp_path / name / "x").read_bytes() == b"x"
    assert mode(tmp_path / "b") == 0o700
    with pytest.raises(KeyError), folder_whole(tmp_path / "c") as folder:
        raise KeyError
    assert sorted(os.listdir(tmp_path)) == ["a", "b"]


def test_folders_that_cannot_be_new_are_refused(tmp_path: Path) -> None:
    """One that holds something, a file, one in no folder, and a name too long are refused by name."""
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").touch()
    (tmp_path / "file").touch()
    for name, words in (("full", "is not empty"), ("file", "is a file, expected a folder"), ("nope/a", "nope does not exist")):
        with pytest.raises(UsageError, match=f"{tmp_path / name}: .*{words}"):
            require_new_folder(tmp_path / name)
    with pytest.raises(UsageError, match="File name too long"):
        require_new_folder(tmp_path / ("x" * 300))


def test_what_is_read_is_known_by_any_road(tmp_path: Path) -> None:
    """A file that was opened to read is an input under its name and through links; one that is written, or looked at aside, is none."""
    for name in ("read", "aside"):
        (tmp_path / name).write_text("x")
    begin()
    (tmp_path / "read").read_bytes()
    with unnoted():
        (tmp_path / "aside").read_text()
    (tmp_path / "written").write_text("x")
    (tmp_path / "link").symlink_to("read")
    os.link(tmp_path / "read", tmp_path / "twin")
    assert [reads(tmp_path / name) for name in ("read", "link", "twin", "aside", "written", "nope")] == [True] * 3 + [False] * 3
    assert str(tmp_path / "read") in opened()
    begin()
    assert not reads(tmp_path / "read")
