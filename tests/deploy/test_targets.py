"""Targets in files: read, corrected, and written back with every other byte as it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from urdfcal.base.errors import InputError, MeasurementError, UsageError
from urdfcal.base.geometry import DEG
from urdfcal.deploy.orientations import FIXED_ANGLES, KUKA_ANGLES, QUATERNION, QUATERNION_W_FIRST, ROTATION_VECTOR, Orientation
from urdfcal.deploy.programs.languages import read_program
from urdfcal.deploy.target_csv import near_from, read_targets
from urdfcal.deploy.targets import corrected, with_coupled_axes
from urdfcal.output.stored import corrected_robot
from urdfcal.robot.robot import load_robot
from urdfcal.robot.way import Way

WRITTEN = [QUATERNION, QUATERNION_W_FIRST, FIXED_ANGLES, KUKA_ANGLES, ROTATION_VECTOR]


@pytest.fixture(scope="module")
def ur5(example_robots: Path) -> Way:
    """A UR5 up to its flange."""
    return Way.between(load_robot(example_robots / "ur_description" / "urdf" / "ur5_robot.urdf"), "tool0")


@pytest.mark.parametrize("written", WRITTEN, ids=lambda written: written.name)
def test_orientations_come_back(written: Orientation, rng: np.random.Generator) -> None:
    """Numbers, to a rotation, and back: the same numbers, whichever of those that mean it they were."""
    for _ in range(50):
        quaternion = rng.normal(size=4)
        for numbers in written.candidates(quaternion / np.linalg.norm(quaternion)):
            R = written.rotations(numbers[None])[0]
            assert np.allclose(R, pin.Quaternion(quaternion / np.linalg.norm(quaternion)).matrix(), atol=1e-9)
            assert np.allclose(written.numbers(R, numbers + 1e-3), numbers, atol=1e-8)


def test_angles_are_those_of_the_makers() -> None:
    """KUKA's A turns about z first; a UR's rotation vector is one; roll, pitch, yaw are about fixed axes."""
    A, B, C = 0.3, -0.4, 0.5
    z, y, x = (pin.AngleAxis(angle, axis).matrix() for angle, axis in zip((A, B, C), np.eye(3)[::-1], strict=True))
    assert np.allclose(KUKA_ANGLES.rotations(np.array([[A, B, C]]))[0], z @ y @ x)
    assert np.allclose(FIXED_ANGLES.rotations(np.array([[C, B, A]]))[0], z @ y @ x)
    assert np.allclose(ROTATION_VECTOR.rotations(np.array([[A, B, C]]))[0], pin.exp3(np.array([A, B, C])))


def test_nothing_but_numbers_is_touched(ur5: Way, tmp_path: Path) -> None:
    """Blanks, quotes, comments, line ends, a byte-order mark and other columns stay; where nothing is wrong, so do the numbers."""
    names = ",".join(f"{name} [deg]" for name in ur5.names)
    text = f'name,{names},note\r\n# a comment, with 1.5\r\n"a, b", 10.50,-80,"90.25",+20.000,30,40,"x, ""y"""\n\nc,1,-2,3,4,5,6,\r'
    path = tmp_path / "t.csv"
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    file = read_targets(path, ur5)
    same = corrected(file, ur5, ur5.placements)
    assert file.with_numbers([each.values for each in same]) == path.read_bytes()
    moved = file.with_numbers([each.values + 0.001 * DEG for each in same]).decode("utf-8-sig")
    assert '"a, b", 10.501,-79.999,"90.251",+20.001,30.001,40.001,"x, ""y"""' in moved


def test_an_axis_that_is_counted_from_the_horizontal(ur5: Way, tmp_path: Path, rng: np.random.Generator) -> None:
    """The description's joint 3 is J3 + J2: what is corrected, and told again, are the positions that the controller has."""
    errors = {name: ur5.robot.tree.joints[name].origin * pin.exp6(rng.normal(0, 1e-3, 6)) for name in ur5.names}
    real = Way.between(corrected_robot(ur5.robot, errors), ur5.tool)
    own = np.array([0.3, -1.2, 1.4, -0.6, 1.2, 0.3])
    told = own - np.array([0, 0, own[1], 0, 0, 0])  # J3 = joint 3 - J2
    path = tmp_path / "t.csv"
    path.write_text(",".join(ur5.names) + "\n" + ",".join(f"{value:.12f}" for value in told))
    (found,) = corrected(with_coupled_axes(read_targets(path, ur5), 6, 1.0), ur5, real.placements)
    reached = found.values + np.array([0, 0, found.values[1], 0, 0, 0])
    np.testing.assert_allclose(real.placements(reached[None]), ur5.placements(own[None]), atol=1e-9)
    with pytest.raises(UsageError, match="expected 1 or -1"):
        with_coupled_axes(read_targets(path, ur5), 6, float("nan"))


def test_all_targets_out_of_reach_are_named_by_their_lines(ur5: Way, tmp_path: Path) -> None:
    """The first with what is left over, and the lines of others; whether their configuration stands beside or is that before."""
    rows = ["0.4,-0.2,0.3", "2.4,-0.2,0.3", "0.4,-0.2,0.35", "3.4,-0.2,0.3"]
    path, near = tmp_path / "t.csv", np.array([0, -1.5, 1.5, 0, 1.5, 0])
    for head, behind in (("", ""), (f",{','.join(ur5.names)}", ",0,-1.5,1.5,0,1.5,0")):
        path.write_text(f"x,y,z,qx,qy,qz,qw{head}\n" + "\n".join(f"{row},0,1,0,0{behind}" for row in rows))
        with pytest.raises(InputError, match=r"t.csv:3: the nominal robot does not reach this target: .*, nor that on line 5;"):
            corrected(read_targets(path, ur5), ur5, ur5.placements, near)


def test_decimal_commas_stay_commas(ur5: Way, tmp_path: Path) -> None:
    """A table with `;` and decimal commas gets decimal commas, in cells without one, too; one with points keeps points."""
    names = ";".join(f"{name} [deg]" for name in ur5.names)
    for mark in (",", "."):
        path = tmp_path / "t.csv"
        path.write_text(f"{names}\n1{mark}50;-80;90{mark}25;+20;30;4e1\n")
        file = read_targets(path, ur5)
        moved = file.with_numbers([file.targets[0].values + 0.001 * DEG]).decode()
        assert moved == f"{names}\n1.501;-79.999;90.251;+20.001;30.001;40.001\n".replace(".", mark)


COLUMNS = {"qx,qy,qz,qw": QUATERNION, "roll [deg],pitch [deg],yaw [deg]": FIXED_ANGLES, "rx,ry,rz": ROTATION_VECTOR, "A,B,C": KUKA_ANGLES}


@pytest.mark.parametrize("columns", COLUMNS)
def test_placements_are_read_as_they_are_written(columns: str, ur5: Way, tmp_path: Path, rng: np.random.Generator) -> None:
    """A table of an arm's own placements is reached at the positions that it was made of, and comes back where nothing is wrong."""
    written, q = COLUMNS[columns], np.array([0.3, -1.2, 1.4, -0.5, 1.0, 0.2]) + rng.normal(0.0, 0.2, (5, 6))
    rows = []
    for placed in ur5.placements(q):
        unit = DEG if "deg" in columns or columns == "A,B,C" else 1.0
        rows.append([*placed[:3, 3] * 1e3, *written.numbers(placed[:3, :3], np.zeros(written.count)) / unit])
    path = tmp_path / "t.csv"
    lines = [",".join(f"{value:.9f}" for value in row) for row in rows]
    path.write_text("\n".join([f"x [mm],y [mm],z [mm],{columns}", *lines]))
    found = corrected(read_targets(path, ur5), ur5, ur5.placements, near_from("20,-70,80,-30,60,10", ur5))
    assert np.allclose([each.q for each in found], q, atol=1e-6)
    assert np.allclose([each.values for each in found], [each.target.values for each in found], atol=1e-8)


def test_what_is_no_table_of_targets_is_refused(ur5: Way, tmp_path: Path) -> None:
    """A joint or a coordinate that is missing, two orientations, a quaternion that is none, no configuration: file, line, column."""
    path, some = tmp_path / "t.csv", ",".join(ur5.names[:5])
    for text, word in (
        (f"{some}\n1,1,1,1,1", f"column '{ur5.names[5]}': is missing"),
        ("a,b\n1,2", "is missing, and so are x, y, z"),
        ("x,y,qx,qy,qz,qw\n1,1,0,0,0,1", "column 'z': is missing"),
        ("x,y,z,A,B\n1,1,1,0,0", "no orientation stands beside x, y, z"),
        ("x,y,z,A,B,C,rx,ry,rz\n1,1,1,0,0,0,0,0,0", "more than one orientation"),
        ("x,y,z,qx,qy,qz,qw\n.1,.1,.1,0,0,0,2", "t.csv:2: column 'qx': the quaternion has not the length 1"),
    ):
        path.write_text(text)
        with pytest.raises(MeasurementError, match=word.replace("(", r"\(")):
            read_targets(path, ur5)
    path.write_text("x,y,z,A,B,C\n.1,.1,.1,0,0,0")
    with pytest.raises(InputError, match=r"t.csv:2: nothing says in which configuration"):
        corrected(read_targets(path, ur5), ur5, ur5.placements)
    path.write_text("x,y,z,A,B,C\n5,.1,.1,0,0,0")
    with pytest.raises(InputError, match=r"the nominal robot does not reach this target"):
        corrected(read_targets(path, ur5), ur5, ur5.placements, np.zeros(6))
    program = tmp_path / "p.script"
    program.write_text("movej([0,0,0,0,0,1e300])")
    with pytest.raises(InputError, match=r"p.script:1: 1e300 is farther than any robot goes"):
        corrected(read_program(program, ur5), ur5, ur5.placements)
    with pytest.raises(UsageError, match=r"expected 6 numbers, in deg"):
        near_from("1,2", ur5)
