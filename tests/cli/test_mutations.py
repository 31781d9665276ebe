"""Good files of every kind, broken at random: never a traceback, never half an output, whatever the command."""

from __future__ import annotations

import os
import re
import resource
import shutil
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import cv2
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
ERRORS = "error_model: placement\nparameters: {lift.trans_x: 0.002, turn.rot_y: 0.003, slide.trans_y: -1e-3}\n"
MARKERS = "dictionary: DICT_4X4_50\nsize_mm: 100\nmarkers: {0: [550, 400], 1: [-550, 400], 2: [550, -400], 3: [-550, -400]}\n"
BENCH = "distance [mm],laser_1.x [mm],laser_1.y [mm],laser_2.x [mm],laser_2.y [mm]\n" + "".join(
    f"{distance},{0.2 * distance + 1},{0.3 + 0.01 * distance},{-0.2 * distance},{0.1 + 0.02 * distance}\n"
    for distance in range(100, 1000, 100)
)
SENSORS = {"points.csv": "point:tool", "pose.csv": "pose:tool", "length.csv": "distance:tool", "level.csv": "inclination:tool"}
SENSORS |= {"plane.csv": "plane:tool", "socket.csv": "socket:tool"}
FIT = {"out.urdf", "out_calibration.yaml"}
COMMANDS = {
    "small.urdf": (
        "fit small.urdf m.csv -o out.urdf --overwrite",
        "check small.urdf m.csv",
        "dh small.urdf",
        "view small.urdf m.csv --html out.html --overwrite",
    ),
    "small.xacro": ("fit small.xacro m.csv -o out.urdf --overwrite --xacro-arg height:=0.2", "dh small.xacro"),
    "m.csv": ("fit small.urdf m.csv -o out.urdf --overwrite", "evaluate small.urdf m.csv", "check small.urdf m.csv"),
    "rig.yaml": ("fit small.urdf m.csv -o out.urdf --overwrite --rig rig.yaml", "check small.urdf m.csv --rig rig.yaml"),
    "c.yaml": ("apply small.urdf c.yaml -o out.urdf --overwrite", "dh small.urdf --calibration c.yaml"),
    "errors.yaml": ("simulate small.urdf -o out.csv --overwrite --poses 5 --errors errors.yaml",),
    "camera.yaml": (
        "render small.urdf one.csv --camera camera.yaml -o out --overwrite",
        "spots p.png --camera camera.yaml -o out.csv --overwrite --robot small.urdf",
    ),
    "one.csv": ("render small.urdf one.csv --camera camera.yaml -o out --overwrite",),
    "p.png": ("spots p.png --pixels -o out.csv --overwrite",),
    "p.jpg": ("spots p.jpg --pixels -o out.csv --overwrite",),
    "p.tif": ("spots p.tif --pixels -o out.csv --overwrite",),
    "bench.csv": ("module bench.csv -o out.yaml --overwrite",),
    "markers.yaml": ("markers markers.yaml -o out.pdf --overwrite",),
    **{name: (f"fit small.urdf {name} -o out.urdf --overwrite", f"evaluate small.urdf {name}") for name in SENSORS},
}
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


@dataclass
class Good:
    """Files that are taken as they are, and what each command leaves of them."""

    files: dict[str, bytes] = field(default_factory=dict)
    outputs: dict[str, set[str]] = field(default_factory=dict)


@pytest.fixture(scope="module")
def kept() -> Good:
    """What `good` has made already."""
    return Good()


@pytest.fixture
def good(kept: Good, run_cli: Callable[..., CliResult], tmp_path: Path, small_pictures: None) -> Good:
    """Files of every kind, each taken by a command, made once."""
    if kept.files:
        for name, content in kept.files.items():
            (tmp_path / name).write_bytes(content)
        return kept
    texts = {"small.urdf": URDF, "small.xacro": XACRO, "rig.yaml": RIG, "errors.yaml": ERRORS, "markers.yaml": MARKERS, "bench.csv": BENCH}
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    making = [
        "simulate small.urdf -o m.csv --poses 20 --errors 5mm,0.5deg --spot-noise-mm 0.3",
        "simulate small.urdf -o one.csv --poses 1",
        "fit small.urdf m.csv -o c.urdf --error-model placement",
        "render small.urdf one.csv -o pictures --spot-mm 30",
        *(f"simulate small.urdf -o {name} --poses 40 --errors 10mm,1deg --sensor {sensor}" for name, sensor in SENSORS.items()),
    ]
    for command in making:
        assert (run := run_cli(*command.split())).code == 0, (command, run)
    picture = cv2.imread(str(tmp_path / "pictures" / "1.png"))
    for ending in ("png", "jpg", "tif"):
        cv2.imwrite(str(tmp_path / f"p.{ending}"), picture)
    (tmp_path / "camera.yaml").write_bytes((tmp_path / "pictures" / "camera.yaml").read_bytes())
    stored = (tmp_path / "c_calibration.yaml").read_text()
    (tmp_path / "c.yaml").write_text(
        re.sub("created: .*", "created: '2026-11-22T00:00:00+00:00'", stored)
    )  # every mutation can be repeated
    files = {name: (tmp_path / name).read_bytes() for name in COMMANDS}
    sweep(tmp_path, set(files))
    for command in dict.fromkeys(command for commands in COMMANDS.values() for command in commands):
        run = run_cli(*command.split())
        assert run.code == 0 or (command.startswith("fit") and run.code == 3), (command, run)  # some sensors see too little
        kept.outputs[command] = sweep(tmp_path, set(files)) or (FIT if command.startswith("fit") else set())
    kept.files.update(files)
    return kept


def sweep(folder: Path, kept: set[str]) -> set[str]:
    """Remove what else is in a folder; its names."""
    left = set(os.listdir(folder)) - kept
    for name in left:
        path = folder / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    return left


def complaint(result: CliResult, expected: set[str], left: set[str]) -> str:
    """What is wrong about the end of a run, or the empty string."""
    errors = [line for line in result.err.splitlines() if not line.startswith("urdfcal: warning: ")]
    if result.code not in (0, 2, 3):
        return f"exit code {result.code}: {errors}"
    if len(errors) != (result.code != 0):
        return f"exit code {result.code} and {len(errors)} lines on stderr: {errors}"
    if "RuntimeWarning" in result.err or "Traceback" in result.err + result.out:
        return f"exit code {result.code} and {result.err}"
    return "" if left == (expected if result.code == 0 else set()) else f"exit code {result.code} and the files {sorted(left)}"


def break_files(
    count: int, name: str, good: Good, run_cli: Callable[..., CliResult], folder: Path
) -> tuple[Counter[int], list[str], float]:
    """Break one file so many times and run a command on it; exit codes, complaints and the slowest; a number names the mutation again."""
    codes: Counter[int] = Counter()
    wrong, slowest = [], 0.0
    for number in range(count):
        rng = np.random.default_rng([number, list(COMMANDS).index(name)])
        broken = good.files[name]
        for _ in range(int(rng.choice([1, 1, 2, 3]))):
            broken = MUTATIONS[int(rng.integers(len(MUTATIONS)))](broken, rng) or b"a 1\n"
        command = COMMANDS[name][int(rng.integers(len(COMMANDS[name])))]
        (folder / name).write_bytes(broken)
        began = time.perf_counter()
        result = run_cli(*command.split())
        slowest = max(slowest, time.perf_counter() - began)
        if said := complaint(result, good.outputs[command], sweep(folder, set(good.files))):
            wrong.append(f"mutation {number} of {name}: {command}: {said}: {broken[:3000]!r}")
        codes[result.code] += 1
    return codes, wrong, slowest


@pytest.mark.parametrize("name", COMMANDS)
def test_broken_files_end_in_order(name: str, good: Good, run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """300 random mutations over every kind of file and command: exit 0, 2 or 3, at most one error line, all outputs or none."""
    codes, wrong, _ = break_files(-(-300 // len(COMMANDS)), name, good, run_cli, tmp_path)
    assert not wrong, wrong[0]
    assert codes.total() > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_many_broken_files_end_in_order(name: str, good: Good, run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """10 000 of them: the same; and every kind of file can be broken so that it is refused."""
    count = int(os.environ.get("URDFCAL_MUTATIONS", "10000"))
    codes, wrong, slowest = break_files(-(-count // len(COMMANDS)), name, good, run_cli, tmp_path)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    print(f"{name}: exit codes {dict(codes)}, slowest {slowest:.1f} s, peak {peak} MB, complaints {len(wrong)}")
    assert not wrong, "\n".join(wrong)
    assert codes[2] > 0, codes
