"""The module's beams from a bench: the truth comes back, the sigmas hold what they promise, and a fit takes them as its prior."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import CliResult
from urdfcal.base.errors import MeasurementError, UsageError
from urdfcal.base.tables import read_table
from urdfcal.calibration.rig_file import read_rig_file
from urdfcal.model.gauge import build_error_model
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.vision.bench.beams import BenchReadings, beam_direction, beams_from_bench, predicted_readings, readings_from, relative_angles
from urdfcal.vision.bench.misreadings import beams_without_misreadings
from urdfcal.vision.bench.module_file import beam_priors, nominal_axes

TRUE = np.radians([[-27.80, 1.27], [31.07, 0.82]])  # equation (16)
ORIGINS = np.array([[0.002, -0.001], [-0.001, 0.0015]])
DISTANCE = np.array([0.3, 0.5, 0.7, 0.9])


def readings(rng: np.random.Generator, noise: float = 0.2e-3, tilt: float = np.radians(0.2)) -> BenchReadings:
    state = np.concatenate([np.hstack([TRUE, ORIGINS]).ravel(), rng.normal(0, tilt, 2) if tilt else np.zeros(2)])
    found = predicted_readings(state, DISTANCE)
    return BenchReadings(("laser_1", "laser_2"), DISTANCE, found + rng.normal(0, noise, found.shape))


def bench_csv(data: BenchReadings) -> str:
    lines = ["distance [mm],laser_1.x [mm],laser_1.y [mm],laser_2.x,laser_2.y"]
    lines += [
        f"{d * 1e3:.6f},{s[0, 0] * 1e3:.9f},{s[0, 1] * 1e3:.9f},{s[1, 0]:.12f},{s[1, 1]:.12f}"
        for d, s in zip(data.distance, data.spots, strict=True)
    ]
    return "\n".join(lines) + "\n"


def test_the_beam_is_rot_x_rot_y_of_z() -> None:
    """The direction is that of the two rotation matrices, written out."""
    a, b = 0.3, -0.2
    rot_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    rot_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    assert beam_direction(a, b) == pytest.approx(rot_x @ rot_y @ [0, 0, 1])


def test_predicted_readings_lie_on_the_tilted_plane_and_the_beam() -> None:
    """A reading, put back on the tilted plane, is a point of the beam."""
    state = np.array([0.4, -0.1, 0.003, 0.002, 0.02, -0.03])
    spot = predicted_readings(state, np.array([0.6]))[0, 0]
    s, t = state[-2:]
    rot_x = np.array([[1, 0, 0], [0, np.cos(s), -np.sin(s)], [0, np.sin(s), np.cos(s)]])
    rot_y = np.array([[np.cos(t), 0, np.sin(t)], [0, 1, 0], [-np.sin(t), 0, np.cos(t)]])
    point = np.array([0, 0, 0.6]) + (rot_x @ rot_y)[:, :2] @ spot
    assert np.linalg.norm(np.cross(point - [0.003, 0.002, 0], beam_direction(0.4, -0.1))) < 1e-12


def test_a_degree_of_tilt_reads_as_a_quarter_degree_of_beam() -> None:
    """A plane tilted by 1 deg about x, taken as square, moves a beam at 30 deg by about sin^2(30 deg) = 0.25 deg."""
    state = np.array([np.radians(-30), 0.0, 0.0, 0.0, np.radians(1.0), 0.0])
    data = BenchReadings(("laser_1",), DISTANCE, predicted_readings(state, DISTANCE))
    off = np.degrees(beams_from_bench(data, squareness=0.0).angles[0, 0]) + 30
    assert abs(off) == pytest.approx(0.25, abs=0.02)


def test_the_angles_of_the_paper_come_back(rng: np.random.Generator) -> None:
    """From four distances with 0.2 mm of noise and a plane square to 0.2 deg, (16) lies within three sigmas."""
    result = beams_from_bench(readings(rng))
    assert np.abs((result.angles - TRUE) / result.angle_sigmas).max() < 3
    assert result.origins == pytest.approx(ORIGINS, abs=1.5e-3)
    assert beams_from_bench(readings(rng, noise=0.0, tilt=0.0)).angles == pytest.approx(TRUE, abs=1e-9)


@pytest.mark.parametrize("stated", [None, 0.2e-3], ids=["estimated noise", "stated noise"])
def test_the_sigmas_hold_what_they_promise(stated: float | None) -> None:
    """Over 200 benches, each with its own tilt, errors over sigmas have RMS one, and 95 % lie within 1.96."""
    rng = np.random.default_rng(4)
    ratios = []
    for _ in range(200):
        result = beams_from_bench(readings(rng), noise=stated)
        ratios.append((result.angles - TRUE) / result.angle_sigmas)
    rms = np.sqrt(np.mean(np.square(ratios)))
    assert rms == pytest.approx(1.0, abs=0.1), f"RMS of error over sigma: {rms}"
    assert 0.93 < np.mean(np.abs(ratios) < 1.96) < 0.975


def test_corrections_turn_the_nominal_beam_into_the_bench_s(robots: dict[str, Robot]) -> None:
    """With the two corrections in the error model, the laser's link points along the bench's beam."""
    robot = robots["arm7"]
    from urdfcal.model.options import ModelOptions

    errors = build_error_model(robot.chain, robot.rig, ModelOptions(estimate=("beams",)))
    for laser, (a, b) in zip(robot.rig.lasers, TRUE, strict=True):
        x = np.zeros(len(errors.names))
        values = relative_angles(nominal_axes(robot, laser), a, b)
        for axis, value in zip("xy", values, strict=True):
            x[errors.names.index(f"{laser}.rot_{axis}")] = value
        joint = next(joint for joint in robot.tree.joints.values() if joint.child == laser)
        origin = errors.corrected_origins(x)[joint.name]
        assert origin.rotation[:, 2] == pytest.approx(beam_direction(a, b), abs=1e-12)


def test_bench_to_prior_to_fit(
    tmp_path: Path, rng: np.random.Generator, robots: dict[str, Robot], run_cli: Callable[..., CliResult]
) -> None:
    """A module with the paper's true beams on a robot whose URDF says +-30 deg: bench, module.yaml and fit give the beams back."""
    robot = robots["arm7"]
    arm = robot.description.path
    (tmp_path / "bench.csv").write_text(bench_csv(readings(rng)))
    done = run_cli("module", "bench.csv", "--robot", arm, "-o", "module.yaml", "--json")
    assert done.code == 0, done.err
    truth = {
        f"{laser}.rot_{axis}": value
        for laser, (a, b) in zip(robot.rig.lasers, TRUE, strict=True)
        for axis, value in zip("xy", relative_angles(nominal_axes(robot, laser), a, b), strict=True)
    }
    priors = json.loads(done.out)["priors"]
    assert max(abs(priors[name]["value"] - value) / priors[name]["sigma"] for name, value in truth.items()) < 3
    rig = read_rig_file(tmp_path / "module.yaml").options()
    assert {name: entry.mean for name, entry in rig.single.items()} == pytest.approx({n: p["value"] for n, p in priors.items()}, rel=1e-6)

    (tmp_path / "errors.yaml").write_text("estimate: [beams]\nparameters:\n" + "".join(f"  {n}: {v}\n" for n, v in truth.items()))
    from urdfcal.calibration.reach import draw_poses
    from urdfcal.model.options import ModelOptions
    from urdfcal.sensors.measurements_csv import write_measurements
    from urdfcal.simulation.readings import SimulatedNoise, simulate

    errors = build_error_model(robot.chain, robot.rig, ModelOptions(estimate=("beams",)))
    x = np.array([truth.get(name, 0.0) for name in errors.names])
    q = draw_poses(robot, errors, x, 40, rng)
    write_measurements(tmp_path / "m.csv", simulate(robot, errors, x, q, rng, SimulatedNoise(0.5e-3)))
    fitted = run_cli("fit", arm, "m.csv", "--rig", "module.yaml", "--spot-sigma-mm", "0.5", "-o", "out.urdf", "--json", "--force")
    assert fitted.code == 3, fitted.err  # the arm is right already, and only its beams are made better
    found = {entry["name"]: entry for entry in json.loads(fitted.out)["parameters"]}
    for name, value in truth.items():
        assert abs(found[name]["value"] - value) < 4 * found[name]["sigma"], f"{name}: {found[name]}, true {value}"
        assert found[name]["sigma"] <= 1.01 * priors[name]["sigma"]
    corrected = load_robot(tmp_path / "out.urdf")
    for laser, (a, b) in zip(robot.rig.lasers, TRUE, strict=True):
        assert nominal_axes(corrected, laser)[:, 2] == pytest.approx(beam_direction(a, b), abs=5e-3)


def test_a_module_file_is_for_the_beams_that_it_was_made_for(
    tmp_path: Path, rng: np.random.Generator, robots: dict[str, Robot], run_cli: Callable[..., CliResult]
) -> None:
    """Relative to a URDF's beams it fits that URDF and is refused beside its calibrated one, where the angles would count twice;
    made for a URDF that holds the bench's angles, it is refused beside one that does not. `evaluate` takes it as it is."""
    arm = robots["arm7"].description.path
    (tmp_path / "bench.csv").write_text(bench_csv(readings(rng)))
    assert run_cli("simulate", arm, "-o", "m.csv", "--poses", "40", "--spot-noise-mm", "0.5").code == 0
    assert run_cli("module", "bench.csv", "--robot", arm, "-o", "own.yaml").code == 0
    assert run_cli("module", "bench.csv", "-o", "holds.yaml").code == 0
    assert run_cli("fit", arm, "m.csv", "--rig", "own.yaml", "-o", "out.urdf", "--force").code == 0
    before = sorted(tmp_path.rglob("*"))
    for words in (("fit", "out.urdf", "m.csv", "-o", "more.urdf", "--rig", "own.yaml"), ("check", arm, "m.csv", "--rig", "holds.yaml")):
        done = run_cli(*words)
        assert (done.code, done.err.count("\n")) == (2, 1), done.err
        assert f"{words[-1]}: entry 'beams': the parameters are relative to a laser_1 along (" in done.err
    assert sorted(tmp_path.rglob("*")) == before
    assert run_cli("evaluate", "out.urdf", "m.csv", "--rig", "own.yaml").code == 0


def test_a_urdf_that_holds_the_angles_has_priors_of_zero(rng: np.random.Generator) -> None:
    """Without a robot the values are zero and the sigmas those of the bench."""
    result = beams_from_bench(readings(rng))
    priors = beam_priors(result)
    assert [value for value, _ in priors.values()] == pytest.approx([0, 0, 0, 0], abs=1e-12)
    assert priors["laser_1.rot_y"][1] == pytest.approx(result.angle_sigmas[0, 1], rel=0.05)


def test_what_was_mistyped_is_left_out_and_named(tmp_path: Path, rng: np.random.Generator, run_cli: Callable[..., CliResult]) -> None:
    """A reading 100 mm off, or a distance, is named with its line and left out; the beams are as without it, and the rest is told."""
    data = readings(rng)
    for column, what in (("spots", "laser_2 at 700 mm lies"), ("distance", "laser_1 and laser_2 at 800 mm lie up to")):
        wrong = replace(data, spots=data.spots.copy(), distance=data.distance.copy())
        getattr(wrong, column)[(2, 1, 1) if column == "spots" else 2] += 0.1
        (tmp_path / "bench.csv").write_text(bench_csv(wrong))
        done = run_cli("module", "bench.csv", "-o", "module.yaml", "--overwrite")
        assert (done.code, done.err.count("\n")) == (0, 1)
        assert f"warning: bench.csv:4: {what}" in done.err
        assert "left out" in (tmp_path / "module.yaml").read_text()
        assert "readings fit to 0." in done.out
        result, left_out, doubtful = beams_without_misreadings(wrong, np.radians(0.2))
        rest = replace(wrong, spots=np.where(np.isfinite(result.residual), data.spots, np.nan))
        assert [(found.row, doubtful) for found in left_out] == [(2, [])]
        assert result.angles == pytest.approx(beams_from_bench(rest).angles, abs=1e-12)


def test_too_few_readings_to_say_which_is_wrong(rng: np.random.Generator) -> None:
    """Of three readings of a laser any may be the wrong one: all three are named and none is left out, nor of four with no noise known."""
    data = readings(rng)
    data.spots[3, 0] = np.nan
    data.spots[1, 0, 0] += 0.1
    _, left_out, doubtful = beams_without_misreadings(data, np.radians(0.2))
    assert (left_out, {(found.row, found.lasers) for found in doubtful}) == ([], {(row, ("laser_1",)) for row in range(3)})
    alone = BenchReadings(("laser_2",), DISTANCE, readings(rng).spots[:, 1:])
    alone.spots[1, 0, 0] += 0.1
    _, left_out, doubtful = beams_without_misreadings(alone, np.radians(0.2))
    assert (left_out, [found.row for found in doubtful]) == ([], [1])


def test_healthy_benches_keep_their_readings() -> None:
    """Of 40 benches with 0.2 mm of noise, as many read to the full millimetre, and as many with a fifth of their noise stated, at most
    three lose a reading."""
    rng = np.random.default_rng(6)
    benches = [readings(rng) for _ in range(120)]
    rounded = [replace(data, spots=np.round(data.spots, 3)) for data in benches[40:80]]
    stated = [(data, 0.04e-3) for data in benches[80:]]
    cases = [*((data, None) for data in benches[:40] + rounded), *stated]
    assert sum(bool(beams_without_misreadings(data, np.radians(0.2), noise)[1]) for data, noise in cases) <= 3


GOOD = "distance [mm],laser_1.x,laser_1.y\n300,0.01,0.15\n500,0.01,0.25\n700,0.01,0.36\n900,0.01,0.46\n"
BAD = {
    "no distance": (GOOD.replace("distance [mm]", "d"), "bench.csv:1: column 'distance': is missing"),
    "no laser": ("distance\n1\n", "bench.csv:1: column 'laser_1.x': is missing"),
    "no y": ("distance,laser_1.x\n1,2\n", "bench.csv:1: column 'laser_1.y': is missing"),
    "word": (GOOD.replace("0.25", "far"), "bench.csv:3: column 'laser_1.y': 'far' is not a number; expected a number"),
    "lone cell": (GOOD.replace("0.01,0.25", ",0.25"), "bench.csv:3: column 'laser_1.x': one cell of the reading is empty"),
    "unit": (GOOD.replace("[mm]", "[inch]"), "bench.csv:1: column 'distance': unit 'inch' is not understood, expected m or mm"),
    "negative": (GOOD.replace("500", "-500"), "bench.csv:3: column 'distance': '-500' is not above zero"),
    "metres": (
        GOOD.replace("distance [mm]", "distance"),
        "bench.csv:2: column 'distance': 300 m, expected a distance of 0.001 to 50 m; if it is in mm, head the column 'distance [mm]'",
    ),
    "millimetres": (
        GOOD.replace("300,", "0.3,"),
        "bench.csv:2: column 'distance': 0.3 mm, expected a distance of 0.001 to 50 m; if it is in m, head the column 'distance [m]'",
    ),
    "wide": (
        GOOD.replace("0.25", "250"),
        "bench.csv:3: column 'laser_1.y': 250 m, expected no more than 10 times the distance; if it is in mm, head the column",
    ),
    "one distance": ("distance,laser_1.x,laser_1.y\n1,2,3\n1,2,3\n", "laser_1 was read at fewer than two distances"),
    "too few": ("distance,laser_1.x,laser_1.y\n1,.1,.3\n2,.1,.6\n", "2 readings leave 0 to estimate their noise from"),
    "empty": ("", "bench.csv: the file has no header line; expected distance, <laser>.x, <laser>.y"),
    "short row": (GOOD + "1000,2\n", "bench.csv:6: the row has 2 cells, expected 3"),
    "twice": (GOOD.replace("laser_1.y", "laser_1.x"), "bench.csv:1: column 'laser_1.x': stands twice, in cells 2 and 3"),
}


@pytest.mark.parametrize(("text", "said"), BAD.values(), ids=BAD)
def test_broken_readings_are_refused_in_one_line(text: str, said: str, tmp_path: Path, run_cli: Callable[..., CliResult]) -> None:
    """Bad input names file, line and column, exits with 2 and writes nothing."""
    (tmp_path / "bench.csv").write_text(text)
    done = run_cli("module", "bench.csv", "-o", "module.yaml")
    assert done.code == 2
    assert said in done.err
    assert done.err.count("\n") == 1
    assert not (tmp_path / "module.yaml").exists()


def test_units_and_empty_cells(tmp_path: Path) -> None:
    """Millimetres become metres, and a reading of one laser may be missing."""
    (tmp_path / "bench.csv").write_text("distance [mm];laser_1.x [mm];laser_1.y\n500;1,5;0,25\n700;;\n900;2;0,4\n")
    found = readings_from(read_table(tmp_path / "bench.csv", "columns", "rows"))
    assert found.distance == pytest.approx([0.5, 0.7, 0.9])
    assert found.spots[0, 0] == pytest.approx([0.0015, 0.25])
    assert np.isnan(found.spots[1]).all()
    with pytest.raises(UsageError, match="--reading-sigma-mm"):
        beams_from_bench(found)
    assert beams_from_bench(found, noise=1e-3).stated
    with pytest.raises(MeasurementError, match="cannot be read"):
        read_table(tmp_path / "none.csv", "columns", "rows")
