"""Measurements of real robots: held-out errors against reference figures, and one command a set. Skipped where the data are not there."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import urdfcal
from tests.benchmarks.real_robots import ROBOTS, Errors, RealRobot, left_over, repeatable_splits
from tests.conftest import CliResult
from tests.support.paths import SHARED_DATA

DATA = SHARED_DATA
BY_FOLDER = {robot.folder: robot for robot in ROBOTS}
SPLITS = [(robot.folder, name) for robot in ROBOTS for name in robot.reference]
SCATTER = 1.07  # the reference figures are of random splits of the same sizes
AGAINST = ({"error_model": "placement"}, {"error_model": "offset"}, {"evidence": False})
SLACK = 1.03  # how much better than the defaults another choice may be on one set


def folder_of(robot: RealRobot) -> Path:
    """Where its data are; skips where they are not."""
    folder = DATA / robot.folder
    if not folder.is_dir():
        pytest.skip(f"no ../shared/data/{robot.folder}: real measurements are not part of this project, see robots/README.md")
    return folder


@dataclass(frozen=True)
class HeldOut:
    """RMS distances on poses that were not fitted [mm], mean over the splits of one name, and that of the orientations [deg]."""

    before: float
    after: float
    turned: float


@cache
def held_out(folder: str, split_name: str, options: tuple[tuple[str, object], ...] = ()) -> HeldOut:
    """Fit every split of a name and predict its test poses."""
    robot = BY_FOLDER[folder]
    folder_of(robot)
    nominal, data = robot.load(DATA)
    before, after = Errors(), Errors()
    for split in repeatable_splits(robot, data):
        if split.name == split_name:
            test = robot.part(data, split.test)
            found = urdfcal.fit(nominal, robot.part(data, split.train), **dict(options))  # type: ignore[arg-type]
            assert not found.rejection, found.rejection
            before.add(found.nominal.residuals(test), test)
            after.add(left_over(found, test), test)
    return HeldOut(rms(before.mm), rms(after.mm), rms(after.deg) if after.deg else np.nan)


def rms(splits: list[np.ndarray]) -> float:
    """Root of the mean square of each split, averaged."""
    return float(np.mean([np.sqrt(np.mean(each**2)) for each in splits]))


@pytest.mark.parametrize(("folder", "split"), SPLITS)
def test_held_out_errors_are_no_worse_than_the_reference_figures(folder: str, split: str) -> None:
    """The defaults reach what a plain ridge-regularised fit of six numbers a joint reached, and halve the nominal robot's error."""
    found, reference = held_out(folder, split), BY_FOLDER[folder].reference[split]
    assert found.after <= SCATTER * reference, f"{found.after:.3f} mm, the reference figure is {reference:.3f} mm"
    assert found.after < 0.55 * found.before, f"{found.after:.3f} mm after, {found.before:.3f} mm before"


@pytest.mark.parametrize(("folder", "degrees"), [("ur10_leica", 0.065), ("fr3_camera_board", 0.23)])
def test_held_out_orientations_are_those_that_were_measured(folder: str, degrees: float) -> None:
    """Where whole poses were measured the orientation is predicted as well."""
    found = held_out(folder, next(iter(BY_FOLDER[folder].reference)))
    assert found.turned < degrees, f"{found.turned:.4f} deg"


@pytest.mark.slow
@pytest.mark.parametrize(("folder", "split"), SPLITS)
def test_no_other_choice_beats_the_defaults(folder: str, split: str) -> None:
    """Other error models, and priors that are stated, are no better than the defaults by more than a few per cent."""
    defaults = held_out(folder, split, (("gated", False),))
    for options in AGAINST:
        other = held_out(folder, split, (("gated", False), *options.items()))
        assert defaults.after < SLACK * other.after, f"{options}: {other.after:.3f} mm, the defaults {defaults.after:.3f} mm"


def test_places_that_were_never_fitted_are_as_far_apart_as_they_are() -> None:
    """Two sockets of a block are 50 mm apart: so says the calibrated robot of blocks that stood where it was not calibrated."""
    robot = BY_FOLDER["panda_sockets"]
    folder_of(robot)
    nominal, data = robot.load(DATA)
    for split in repeatable_splits(robot, data):
        found = urdfcal.fit(nominal, robot.part(data, split.train))
        ball = ball_positions(found, data.subset(split.test))
        labels = data.subset(split.test).readings[0].labels
        for place in {str(label).split("/")[0] for label in labels}:
            apart = np.linalg.norm(ball[labels == f"{place}/0"].mean(axis=0) - ball[labels == f"{place}/1"].mean(axis=0)) * 1e3
            assert apart == pytest.approx(50.0, abs=0.1), f"{place}: {apart:.3f} mm"


def ball_positions(found: urdfcal.Calibration, test: urdfcal.Measurements) -> np.ndarray:
    """Where Pinocchio has the ball on the calibrated robot, (n, 3), [m]: a second witness beside the sensor's own prediction."""
    import pinocchio as pin

    model = found.apply_to(found.robot.model)
    data, link = model.createData(), model.getFrameId("panda_link8")
    target = pin.SE3.Identity()
    slot = next(slot for slot in found.errors.slots if slot.kind == "target")
    target.translation = slot.found[""].translation + [found.x[found.errors.names.index(f"{slot.label}.{name}")] for name in slot.names[:3]]
    points = []
    for q in test.q:
        full = pin.neutral(model)
        for name, value in zip(test.joints, q, strict=True):
            full[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, data, full)
        points.append((data.oMf[link] * target).translation.copy())
    return np.array(points)


@pytest.mark.parametrize("folder", list(BY_FOLDER))
def test_each_set_fits_with_one_command(folder: str, run_cli: Callable[..., CliResult], example_robots: Path, tmp_path: Path) -> None:
    """`urdfcal fit ROBOT MEASUREMENTS` without any option converges, halves the error and writes the calibrated URDF."""
    robot = BY_FOLDER[folder]
    done = run_cli("fit", example_robots / robot.urdf, folder_of(robot) / "measurements.csv", "--json", "-q")
    assert done.code == 0, done.err
    result = json.loads(done.out)
    target = next(iter(result["after"]))
    assert result["converged"]
    assert result["after"][target]["mean_mm"] < 0.55 * result["before"][target]["mean_mm"]
    assert (tmp_path / f"{Path(robot.urdf).stem}_calibrated.urdf").stat().st_size > 0


def test_figaroh_columns_say_the_same_as_ours(tmp_path: Path) -> None:
    """The TALOS set under figaroh's column names, with its time column, is the same set."""
    robot = BY_FOLDER["talos_left_arm"]
    lines = (folder_of(robot) / "measurements.csv").read_text(encoding="utf-8").splitlines()
    rows = [line for line in lines if not line.startswith("#")]
    header = rows[0].replace("arm_left_7_link.x", "x1").replace("arm_left_7_link.y", "y1").replace("arm_left_7_link.z", "z1")
    path = tmp_path / "figaroh.csv"
    path.write_text("\n".join([f"t,{header}", *(f"{number}.5,{row}" for number, row in enumerate(rows[1:]))]) + "\n", encoding="utf-8")
    nominal, ours = robot.load(DATA)
    theirs = urdfcal.read_measurements(path, nominal, target="arm_left_7_link")
    np.testing.assert_array_equal(theirs.q, ours.q)
    np.testing.assert_array_equal(theirs.readings[0].values, ours.readings[0].values)
