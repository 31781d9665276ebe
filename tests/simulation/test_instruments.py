"""Measurements simulated with several instruments: what each reads, where it stands, and that a fit takes it back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

from tests.conftest import CliResult
from tests.simulation.test_pictures import CAMERA, GRID
from tests.support.paths import ROBOTS_DIR
from urdfcal.api import fit
from urdfcal.base.errors import UsageError
from urdfcal.robot.robot import Robot
from urdfcal.sensors.columns import Stations
from urdfcal.simulation.simulated import Simulation, simulate
from urdfcal.vision.camera.camera_file import camera_yaml

Run = Callable[..., CliResult]
HAND, HEAD, WRIST = "tool0", "forearm_link", "wrist_1_link"
PAIRS = (f"pixels:{HAND}@beside", f"pixels:{WRIST}@beside", f"pose:{HEAD}@leica", f"point:{HAND}:ball@{HEAD}")
STATIONS = Stations({"leica": "", "beside": ""}, cameras={"beside": CAMERA})


@pytest.fixture(scope="module")
def simulated(robots: dict[str, Robot]) -> Simulation:
    """A tracker and a camera beside a UR5, and something on its forearm that sees its hand; nothing has noise."""
    return simulate(
        robots["ur5"],
        24,
        sensors=PAIRS,
        boards={HAND: GRID, WRIST: GRID},
        stations=STATIONS,
        spot_noise=0,
        length_noise=0,
        angle_noise=0,
        pixel_noise=0,
        seed=4,
    )


def placed(simulation: Simulation, label: str) -> pin.SE3:
    """Where an instrument or target was put on its link."""
    slot = next(slot for slot in simulation.errors.slots if slot.label == label)
    return slot.found[""]


def test_readings_are_those_of_the_true_robot(simulated: Simulation) -> None:
    """Every pair's readings are where whole-robot Pinocchio has the target in its instrument's frame, by its lens in pixels."""
    robot, data = simulated.robot, simulated.measurements
    model, frames = robot.model, {name: robot.model.getFrameId(name) for name in (HAND, HEAD, WRIST, robot.tree.root)}
    engine, links = model.createData(), {"beside": robot.tree.root, "leica": robot.tree.root, HEAD: HEAD}
    for pose in range(len(data)):
        q = pin.neutral(model)
        for name, value in zip(data.joints, data.q[pose], strict=True):
            q[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, engine, q)
        for own in data.readings:
            label = f"{own.instrument}:frame" if own.instrument == HEAD else own.instrument
            T = (engine.oMf[frames[links[own.instrument]]] * placed(simulated, label)).actInv(engine.oMf[frames[own.link]])
            if own.kind.by_camera:
                if own.seen[pose]:
                    at = np.array(GRID.at(int(own.target.partition(":")[2])))
                    point = (T * placed(simulated, own.link)).act(at)
                    np.testing.assert_allclose(own.values[pose], CAMERA.project(point[None])[0], atol=1e-6)
            elif own.sensor == "point":
                np.testing.assert_allclose(own.values[pose], (T * placed(simulated, own.target)).translation, atol=1e-9)


def test_each_board_is_seen_in_its_turn(simulated: Simulation) -> None:
    """The poses of a turn show most of that turn's board, so that none of a camera's boards comes short."""
    data = simulated.measurements
    for turn, board in enumerate((HAND, WRIST)):
        corners = sum(own.seen.astype(int) for own in data.readings if own.kind.by_camera and own.link == board)
        assert corners[turn::2].min() >= GRID.corners / 2 - 1


def test_a_fit_finds_all_of_it(simulated: Simulation) -> None:
    """Without noise nothing is left over of any pair."""
    found = fit(simulated.nominal, simulated.measurements, evidence=False, asking=False)
    assert found.converged
    assert len(found.after) == 5
    assert max(row.mean for row in found.after.values()) < 1e-3


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("point:tool0@liece",), "no instrument named 'liece'.*did you mean 'leica'.*expected a link, or name it in rig.yaml"),
        (("point:tool0@",), r"no instrument named ''.*instruments: \{NAME"),
        (("pixels:tool0@leica",), "tool0:0@leica is to be read in pictures: name the camera's lens"),
        (("plane:tool0@leica", "plane:tool0@leica"), "two sensors read the same of one target"),
    ],
)
def test_what_nothing_can_be_made_of_is_refused(robots: dict[str, Robot], words: Sequence[str], message: str) -> None:
    """An instrument that is none, a camera without a lens and a pair that stands twice are named, with the way out."""
    with pytest.raises(UsageError, match=message):
        simulate(robots["ur5"], 9, sensors=words, boards={HAND: GRID}, stations=STATIONS)


def test_one_file_from_the_command_line(run_cli: Run, tmp_path: Path) -> None:
    """The cameras of rig.yaml read all of its boards; a fit with what the file's comments say finds the truth's noise again."""
    (tmp_path / "eye.yaml").write_bytes(camera_yaml(CAMERA))
    rig = {"boards": {HAND: str(GRID)}, "instruments": {name: {"link": "base_link", "camera": "eye.yaml"} for name in ("left", "right")}}
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(rig))
    robot = ROBOTS_DIR / "ur5" / "ur5.urdf.xacro"
    made = run_cli("simulate", robot, "-o", "m.csv", "--rig", "rig.yaml", "--poses", "30", "--seed", "2")
    assert made.code == 0, made.err
    advice = next(line for line in (tmp_path / "m.csv").read_text().splitlines() if "urdfcal fit ..." in line)
    assert advice.endswith("measured from left and right: urdfcal fit ... --rig rig.yaml")
    truth = yaml.safe_load((tmp_path / "m_truth.yaml").read_text())["instruments"]["frames"]
    assert list(truth) == ["measuring frame of left", "measuring frame of right", HAND]
    assert truth["measuring frame of left"]["link"] == "base_link"
    done = run_cli("fit", robot, "m.csv", "--rig", "rig.yaml", "-o", "out.urdf")
    assert done.code == 0, done.err
    assert f"{HAND}@left pixels" in done.out
    assert not any(tmp_path.glob("m_camera.yaml"))
