"""The JSON of commands is what its schemas say, and no key of it is left undescribed."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import jsonschema
import numpy as np
import pytest

from tests.conftest import CliResult
from tests.support.flat_boards import board_camera, facing, rendered
from tests.support.good_files import TARGETS
from tests.support.other_models import MJCF
from tests.support.paths import ROBOTS_DIR
from tests.support.small_robot import URDF
from urdfcal.simulation import study
from urdfcal.vision.camera.camera_file import camera_yaml
from urdfcal.vision.camera.sought import parse_board

SCHEMAS = {
    path.name.removesuffix(".schema.json"): json.loads(path.read_text("utf-8")) for path in (files("urdfcal.output") / "schema").iterdir()
}
ARM7 = str(ROBOTS_DIR / "arm7" / "arm7.urdf.xacro"), str(ROBOTS_DIR / "arm7" / "measurements.csv")
BOARD = "charuco:5x4:30mm:22mm"
RIGS = ("--screen", "1.3,0,0.5"), ("--tracker",)
FEW = "--candidates", "30", "--no-collisions"
SENSORS = "--sensor", "pose:tool", "--sensor", "socket:tool:ball"


@pytest.fixture(scope="module")
def printed() -> dict[str, list[Any]]:
    """What every command printed, made by the first test that asks."""
    return {}


def outputs(run_cli: Callable[..., CliResult], folder: Path) -> dict[str, list[Any]]:
    """Results of each command: with lasers and with other sensors, of a good fit and of a refused one."""
    (folder / "small.urdf").write_text(URDF)
    (folder / "m.xml").write_text(MJCF)
    truth = "small.urdf", "m_truth.yaml"

    def run(*words: str) -> Any:
        return json.loads(run_cli(*words, "--json", "-q").out)

    sensed = "small.urdf", "m.csv"
    simulated = run("simulate", "small.urdf", "-o", "m.csv", *SENSORS, "--poses", "24", "--test-poses", "4", "--seed", "3")
    few = "small.urdf", "few.csv"
    run("simulate", "small.urdf", "-o", "few.csv", "--poses", "3")
    (folder / "targets.csv").write_text(TARGETS)
    run("apply", *truth, "-o", "true.urdf")
    targets = ("small.urdf", "targets.csv", "--calibration", "m_truth.yaml", "--tool", "tool", "-o", "t.csv")
    return {
        "rig": [run("rig", "small.urdf", "--tip", "tool", *rest, "--prefix", "two_", "-o", f"{at}.urdf") for at, rest in enumerate(RIGS)],
        "compare": [run("compare", "small.urdf", "true.urdf"), run("compare", "m_truth.yaml", "small.urdf", "--report", "c.html")],
        "correct": [run("correct", *targets), run("correct", *targets, "--report", "t.html")],
        "boards": [run("boards", *pictures_of_a_board(folder), "--board", f"hand={BOARD}", "--camera", "camera.yaml", "-o", "b.csv")],
        "paper": [paper(run)],
        "poses": [run("poses", "small.urdf", "-o", "p.csv", "--sensor", "point:tool", *FEW, *rest) for rest in ((), ("--check",))],
        "simulate": [simulated, run("simulate", "small.urdf", "-o", "fleet/", "--robots", "2", "--poses", "3")],
        "fit": [run("fit", *ARM7, "-o", "arm7.urdf"), run("fit", *sensed, "-o", "s.urdf", "--kfold", "2"), run("fit", *few)],
        "check": [run("check", *sensed)],
        "evaluate": [run("evaluate", *ARM7), run("evaluate", *sensed)],
        "measurements": [run("measurements", *ARM7), run("measurements", *sensed)],
        "dh": [run("dh", "small.urdf", "--tip", "tool"), run("dh", "small.urdf", "--calibration", "m_truth.yaml")],
        "apply": [run("apply", "small.urdf", "m_truth.yaml", "-o", "a.urdf"), run("apply", *truth, "--onto", "m.xml", "-o", "n.xml")],
    }


def pictures_of_a_board(folder: Path) -> tuple[str, str]:
    """One with the board, one without, and the camera that took them."""
    camera, sought = board_camera(), parse_board(f"hand={BOARD}")
    picture = rendered(camera, [(sought, facing(sought, 0.4, 20, 80))], np.random.default_rng(5), rays=1)
    (folder / "camera.yaml").write_bytes(camera_yaml(camera, {}))
    cv2.imwrite(str(folder / "p.png"), picture)
    cv2.imwrite(str(folder / "q.png"), np.full_like(picture, 128))
    return "p.png", "q.png"


def paper(run: Callable[..., Any]) -> Any:
    """The paper's simulation with a few poses and one reading of each."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setitem(study.STUDIES, 4, replace(study.SECTION_4, half=8, protocols={"one reading": 1}, max_sweeps=20))
        return run("paper", "--section", "4", "--runs", "1")


@pytest.mark.parametrize("command", SCHEMAS)
def test_what_a_command_prints_is_what_its_schema_says(
    command: str, run_cli: Callable[..., CliResult], tmp_path: Path, printed: dict[str, list[Any]]
) -> None:
    """Every result is valid, and each of its keys stands in the schema by name or by pattern."""
    if not printed:
        printed |= outputs(run_cli, tmp_path)
    schema = SCHEMAS[command]
    jsonschema.Draft202012Validator.check_schema(schema)
    for result in printed[command]:
        assert [error.message for error in jsonschema.Draft202012Validator(schema).iter_errors(result)] == []
        assert list(undescribed(result, schema, schema)) == []


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ({"rank": "31"}, ["rank"]),
        ({"verdict": {"use": "maybe", "reasons": [], "advice": []}}, ["verdict", "use"]),
        ({"after": {"laser_1": {}}}, ["after", "laser_1"]),
    ],
)
def test_what_is_no_result_is_not_valid(
    change: dict[str, Any], where: list[str], run_cli: Callable[..., CliResult], tmp_path: Path, printed: dict[str, list[Any]]
) -> None:
    """A number in quotes, a word that no verdict has, or a row of a table without its count is told where it stands."""
    if not printed:
        printed |= outputs(run_cli, tmp_path)
    errors = list(jsonschema.Draft202012Validator(SCHEMAS["fit"]).iter_errors(printed["fit"][0] | change))
    assert [list(error.path) for error in errors] == [where]


def undescribed(value: Any, schema: Any, whole: Any) -> Iterator[str]:
    """Keys that no schema says anything of."""
    if "$ref" in schema:
        schema = whole["$defs"][schema["$ref"].rpartition("/")[2]]
    if isinstance(value, list):
        for item in value:
            yield from undescribed(item, schema.get("items", {}), whole)
    if isinstance(value, dict):
        patterns = schema.get("patternProperties", {})
        for key, own in value.items():
            found = schema.get("properties", {}).get(key) or next((patterns[p] for p in patterns if re.search(p, key)), None)
            found = found if found is not None else schema.get("additionalProperties")
            if not isinstance(found, dict):
                yield key
            else:
                yield from undescribed(own, found, whole)
