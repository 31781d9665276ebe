"""Files that users name are regular files of a sensible size, whatever they are and whoever reads them."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import CliResult
from tests.support.small_robot import CSV, URDF
from urdfcal.base.errors import MeasurementError
from urdfcal.base.reading import content_of

COMMANDS = {
    "robot": "fit ODD m.csv",
    "measurements": "fit r.urdf ODD",
    "rig": "fit r.urdf m.csv --rig ODD",
    "calibration": "apply r.urdf ODD -o out.urdf",
    "errors": "simulate r.urdf -o s.csv --errors ODD",
    "camera": "render r.urdf m.csv --camera ODD -o pictures",
    "markers": "markers ODD -o sheet.pdf",
    "spots": "spots ODD --pixels -o spots.csv",
    "picture": "camera ODD --board 9x6:25mm -o camera.yaml",
    "bench": "module ODD -o module.yaml",
}


@pytest.fixture
def files(tmp_path: Path) -> Path:
    (tmp_path / "r.urdf").write_text(URDF)
    (tmp_path / "m.csv").write_text(CSV)
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "zero.yaml").symlink_to("/dev/zero")
    return tmp_path


@pytest.mark.parametrize("what", COMMANDS)
@pytest.mark.parametrize(("odd", "said"), [("zero.yaml", "is a device"), ("pipe.yaml", "is a pipe")])
def test_devices_and_pipes_are_refused(files: Path, run_cli: Callable[..., CliResult], what: str, odd: str, said: str) -> None:
    """What has no end, or may never begin, is refused in one line by every command that reads a file, and nothing is written."""
    before = set(os.listdir(files))
    result = run_cli(*COMMANDS[what].replace("ODD", odd).split())
    assert (result.code, len(result.err.splitlines())) == (2, 1), result
    assert f"{odd}: {said}, expected a regular file" in result.err
    assert set(os.listdir(files)) == before


def test_a_file_may_have_so_many_bytes_and_no_more(tmp_path: Path) -> None:
    """The bound is exact; what is beyond it is not read."""
    path = tmp_path / "a.csv"
    path.write_bytes(b"x" * (1 << 20))
    assert content_of(path, 1 << 20) == path.read_bytes()
    with path.open("ab") as stream:
        stream.truncate(1 << 40)  # a hole
    with pytest.raises(MeasurementError, match=r"a\.csv: has more than 1 MB"):
        content_of(path, 1 << 20, MeasurementError)


def _png(width: int, height: int) -> bytes:
    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(bytes(100))) + chunk(b"IEND", b"")


@pytest.mark.parametrize("what", ["spots", "picture"])
def test_a_picture_is_refused_by_its_header(files: Path, run_cli: Callable[..., CliResult], what: str) -> None:
    """A small file that states a huge picture is refused before any memory is taken for it."""
    (files / "huge.png").write_bytes(_png(20000, 20000))
    result = run_cli(*COMMANDS[what].replace("ODD", "huge.png").split())
    assert result.code == 2
    assert "huge.png: is 20000 x 20000 px, expected at most 150 Mpx" in result.err
