"""Good files, broken at random: never a traceback, never half an output."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import CliResult
from tests.support.small_robot import URDF, XACRO

RIG = """\
screen: screen
error_models: {lift: placement}
noise: {spot_mm: 0.5, joint_deg: 0.01}
priors: {joint: '1mm,0.1deg', mount: '20mm,2deg', screen: '50mm,2deg'}
parameters:
  lift.rot_x: {sigma_deg: 0.1}
  slm.trans_x: {value_mm: 2.5, sigma_mm: 0.2}
  slide.*: {fixed: true}
"""
COMMANDS = {
    "small.urdf": "fit small.urdf m.csv -o out.urdf --overwrite",
    "small.xacro": "fit small.xacro m.csv -o out.urdf --overwrite --xacro-arg height:=0.2",
    "m.csv": "fit small.urdf m.csv -o out.urdf --overwrite",
    "rig.yaml": "fit small.urdf m.csv -o out.urdf --overwrite --rig rig.yaml",
    "c.yaml": "apply small.urdf c.yaml -o out.urdf --overwrite",
}
OUTPUTS = {"fit": {"out.urdf", "out_calibration.yaml"}, "apply": {"out.urdf"}}
ODD = [
    b"\x00",
    b"\xff",
    b"<",
    b">",
    b"&",
    b'"',
    b"'",
    b"-",
    b"e9",
    b"nan",
    b"{",
    b"[",
    b"*",
    b": ",
    b",",
    b";",
    b"\t",
    b"\n",
    b"\r",
    b"#",
    b"${",
    b"9" * 40,
    "\u00e4".encode(),
]


def flip(text: bytes, rng: np.random.Generator) -> bytes:
    place = int(rng.integers(len(text)))
    return text[:place] + bytes([text[place] ^ (1 << int(rng.integers(8)))]) + text[place + 1 :]


def put_in(text: bytes, rng: np.random.Generator) -> bytes:
    place = int(rng.integers(len(text) + 1))
    return text[:place] + ODD[int(rng.integers(len(ODD)))] + text[place:]


def take_out(text: bytes, rng: np.random.Generator) -> bytes:
    place = int(rng.integers(len(text)))
    return text[:place] + text[place + int(rng.integers(1, 12)) :]


def cut(text: bytes, rng: np.random.Generator) -> bytes:
    return text[: int(rng.integers(len(text)))]


def change_line(text: bytes, rng: np.random.Generator) -> bytes:
    """Double, drop or move a line."""
    lines = text.splitlines(keepends=True)
    one, other = (int(index) for index in rng.integers(len(lines), size=2))
    kind = int(rng.integers(3))
    if kind == 0:
        lines.insert(one, lines[other])
    elif kind == 1:
        del lines[one]
    else:
        lines[one], lines[other] = lines[other], lines[one]
    return b"".join(lines)


def swap_words(text: bytes, rng: np.random.Generator) -> bytes:
    """Swap two numbers or names: cells of a CSV, values of attributes, entries of YAML."""
    words = list(re.finditer(rb"[\w.+-]+", text))
    if not words:
        return text
    first, second = sorted((words[int(index)] for index in rng.integers(len(words), size=2)), key=lambda word: word.start())
    if first.end() > second.start():
        return text
    return text[: first.start()] + second[0] + text[first.end() : second.start()] + first[0] + text[second.end() :]


def change_number(text: bytes, rng: np.random.Generator) -> bytes:
    """Put another number, some of them absurd, where one stands."""
    numbers = list(re.finditer(rb"[-+]?\d+(\.\d*)?(e[-+]?\d+)?", text))
    if not numbers:
        return text
    place = numbers[int(rng.integers(len(numbers)))]
    value = rng.choice([b"0", b"-1", b"3.2", b"1e-300", b"1e300", b"-7e8", b"90", b"1e999", b"0.01"])
    return text[: place.start()] + bytes(value) + text[place.end() :]


MUTATIONS = [flip, put_in, take_out, cut, change_line, swap_words, change_number, change_number]


@pytest.fixture(scope="module")
def kept() -> dict[str, bytes]:
    """What `good` has made already."""
    return {}


@pytest.fixture
def good(kept: dict[str, bytes], run_cli: Callable[..., CliResult], tmp_path: Path) -> dict[str, bytes]:
    """Files with which every command succeeds, made once."""
    if kept:
        for name, content in kept.items():
            (tmp_path / name).write_bytes(content)
        return kept
    for name, text in (("small.urdf", URDF), ("small.xacro", XACRO), ("rig.yaml", RIG)):
        (tmp_path / name).write_text(text)
    assert run_cli("simulate", "small.urdf", "-o", "m.csv", "--poses", "20", "--errors", "5mm,0.5deg", "--spot-noise-mm", "0.3").code == 0
    assert run_cli("fit", "small.urdf", "m.csv", "-o", "c.urdf", "--error-model", "placement").code == 0
    stored = (tmp_path / "c_calibration.yaml").read_text()
    (tmp_path / "c.yaml").write_text(
        re.sub("created: .*", "created: '2026-11-22T00:00:00+00:00'", stored)
    )  # every mutation can be repeated
    for command in COMMANDS.values():
        assert run_cli(*command.split()).code == 0
    files = {name: (tmp_path / name).read_bytes() for name in COMMANDS}
    for name in set(os.listdir(tmp_path)) - set(files):
        (tmp_path / name).unlink()
    kept.update(files)
    return kept


def complaint(result: CliResult, command: str, left: set[str]) -> str:
    """What is wrong about the end of a run, or the empty string."""
    errors = [line for line in result.err.splitlines() if not line.startswith("urdfcal: warning: ")]
    expected = OUTPUTS[command.split()[0]] if result.code == 0 else set()
    if result.code not in (0, 2, 3):
        return f"exit code {result.code}"
    if len(errors) != (result.code != 0):
        return f"exit code {result.code} and {len(errors)} lines on stderr: {errors}"
    return "" if left == expected else f"exit code {result.code} and the files {sorted(left)}"


def break_files(count: int, name: str, good: dict[str, bytes], run_cli: Callable[..., CliResult], folder: Path) -> dict[int, int]:
    """Break one file so many times, run its command on it, and count the exit codes; a number names the mutation again."""
    codes: dict[int, int] = {}
    for number in range(count):
        rng = np.random.default_rng([number, list(COMMANDS).index(name)])
        broken = good[name]
        for _ in range(int(rng.choice([1, 1, 2, 3]))):
            broken = MUTATIONS[int(rng.integers(len(MUTATIONS)))](broken, rng) or b"a 1\n"
        (folder / name).write_bytes(broken)
        try:
            result = run_cli(*COMMANDS[name].split())
        except Exception as error:
            raise AssertionError(f"mutation {number} of {name}: {broken!r}") from error
        left = set(os.listdir(folder)) - set(good)
        assert not complaint(result, COMMANDS[name], left), (
            f"mutation {number} of {name}: {complaint(result, COMMANDS[name], left)}: {broken!r}"
        )
        for output in left:
            (folder / output).unlink()
        codes[result.code] = codes.get(result.code, 0) + 1
    return codes


@pytest.mark.parametrize("name", COMMANDS)
def test_broken_files_end_in_order(name: str, good: dict[str, bytes], run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """40 random mutations of each kind of file: exit 0, 2 or 3, at most one error line, all outputs or none."""
    codes = break_files(40, name, good, run_cli, tmp_path)
    assert codes.get(2, 0) > 0, codes


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_many_broken_files_end_in_order(name: str, good: dict[str, bytes], run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """400 random mutations of each kind of file, 2000 in all: the same."""
    codes = break_files(400, name, good, run_cli, tmp_path)
    print(f"exit codes of {name}: {codes}")
    assert codes.get(2, 0) > 0, codes
