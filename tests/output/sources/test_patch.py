"""A calibration in a xacro's own sources, over packages in the manner of those that there are."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.conftest import CliResult
from tests.support.helpers import assert_poses_close
from tests.support.xacro_idioms import IDIOMS
from tests.support.xacro_packages import PACKAGES, calls, crlf_latin, joint, twice, ur
from urdfcal.base.errors import RobotError, UsageError
from urdfcal.base.geometry import SE3
from urdfcal.output.formats import Deployed, deployment
from urdfcal.output.sources.patch import SourcePatch, patched_sources
from urdfcal.robot.robot import Robot, load_robot, with_text
from urdfcal.robot.urdf_writer import with_origins

ALL = PACKAGES | IDIOMS
PATCHED = [name for name, made in ALL.items() if not made().shared]
SPLIT = [name for name, made in ALL.items() if made().shared and name != "loop"]
QUICK = ("properties", "units", "ur", "conditions", "nested", "offsets_aside", "millimetres")  # the others run with the slow tests
_ADDED = re.compile(rb"""<origin|\s(?:xyz|rpy)\s*=\s*(?:"[^"]*"|'[^']*')|[0-9.eE+(){}$\s-]""")


def shaken(robot: Robot, joints: tuple[str, ...] = ()) -> dict[str, SE3]:
    """Joints, those that move where none is named, with errors of millimetres and half degrees."""
    rng = np.random.default_rng(1)
    wanted = [each for each in robot.tree.joints.values() if each.name in joints or (not joints and each.moves)]
    return {each.name: each.origin * pin.exp6(rng.normal(0, [1e-3] * 3 + [1e-2] * 3)) for each in wanted}


def loaded(name: str, folder: Path) -> tuple[Robot, dict[str, SE3]]:
    package = ALL[name]()
    robot = load_robot(package.write(folder), xacro_args=package.args, package_dirs=[folder])
    return robot, shaken(robot, package.joints)


def require_proven(patch: SourcePatch, robot: Robot, origins: dict[str, SE3], folder: Path) -> None:
    """Changed copies, read by Pinocchio from a place of their own, have the placements, and all other joints what they had."""
    for place, text in patch.copies(folder).items():
        Path(place).parent.mkdir(parents=True, exist_ok=True)
        Path(place).write_bytes(text)
    main = folder / patch.layout.way_in_folder(robot.description.path.resolve())
    again = load_robot(main, xacro_args=robot.description.xacro_args, package_dirs=[folder])
    expected = with_text(robot, with_origins(robot.description, origins)).model
    for name, each in again.tree.joints.items():
        if each.moves:
            number = expected.getJointId(name)
            assert_poses_close(again.model.jointPlacements[number], expected.jointPlacements[number], mm=1e-6, mrad=1e-6)
        elif name in origins:
            assert_poses_close(each.origin, origins[name], mm=1e-6, mrad=1e-6)
        else:
            assert (each.xyz, each.rpy) == (robot.tree.joints[name].xyz, robot.tree.joints[name].rpy)


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("name", [pytest.param(each, marks=() if each in QUICK else pytest.mark.slow) for each in PATCHED])
def test_changed_sources_expand_to_the_calibration_and_only_numbers_changed(name: str, tmp_path: Path) -> None:
    """What is expanded from the changed sources has the placements to 1e-9, and bytes that are no numbers of origins are the same."""
    robot, origins = loaded(name, tmp_path / "arm_description")
    patch = patched_sources(robot.description, origins)
    assert patch.after
    for file, text in patch.after.items():
        assert _ADDED.sub(b"", text).replace(b"/>", b">") == _ADDED.sub(b"", patch.before[file]).replace(b"/>", b">") or name == "literals"
    require_proven(patch, robot, origins, tmp_path / "copies")


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("name", [pytest.param(each, marks=() if each in QUICK else pytest.mark.slow) for each in SPLIT])
def test_a_number_of_several_joints_is_named_or_split(name: str, tmp_path: Path) -> None:
    """Without --split the number is named by file and line with the joints that it feeds; with it each joint gets its own."""
    robot, origins = loaded(name, tmp_path / "arm_description")
    with pytest.raises(RobotError, match=r"\.(xacro|yaml):\d+: '[^']+' feeds \w+ of joint '\w+', .*--split"):
        patched_sources(robot.description, origins)
    require_proven(patched_sources(robot.description, origins, split=True), robot, origins, tmp_path / "copies")


@pytest.mark.slow
def test_joints_of_one_call_are_refused(tmp_path: Path) -> None:
    """Joints that a loop makes from one call cannot be told apart by a parameter, and are named."""
    robot, origins = loaded("loop", tmp_path)
    with pytest.raises(RobotError, match="joint 'j_a' and j_b, j_c come out of one origin by the same calls"):
        patched_sources(robot.description, origins, split=True)


@pytest.mark.usefixtures("in_process")
def test_each_number_is_replaced_in_its_own_place_and_unit(tmp_path: Path) -> None:
    """A correction of one joint changes one number of the YAML, by just that; degrees change in degrees."""
    robot = load_robot(ur().write(tmp_path))
    wanted = {"forearm_joint": robot.tree.joints["forearm_joint"].origin * pin.SE3(np.eye(3), np.array([0.001, 0.0, 0.0]))}
    (changed,) = patched_sources(robot.description, wanted).after.values()
    before = (tmp_path / "urdf/config/default.yaml").read_text().splitlines()
    pairs = zip(before, changed.decode().splitlines(), strict=True)
    assert [(one, other) for one, other in pairs if one != other] == [("    x: -0.425", "    x: -0.424")]

    robot = load_robot(calls().write(tmp_path / "calls"))
    turned = pin.SE3(pin.rpy.rpyToMatrix(np.radians(90.25), 0.0, np.pi / 4), robot.tree.joints["j2"].origin.translation)
    (text,) = patched_sources(robot.description, {"j2": turned}).after.values()
    assert b'r="90.25"' in text


def test_sources_that_changed_meanwhile_are_refused(tmp_path: Path) -> None:
    """A patch is of what was read."""
    robot, origins = loaded("literals", tmp_path)
    place = robot.description.path
    place.write_bytes(place.read_bytes().replace(b"0.333", b"0.334"))
    with pytest.raises(RobotError, match="its sources have changed since"):
        Deployed(robot, origins).content("xacro")


@pytest.mark.usefixtures("in_process")
def test_git_takes_the_patch_and_the_command_line_writes_all_forms(tmp_path: Path, run_cli: Callable[..., CliResult]) -> None:
    """`git apply` makes of the sources what --in-place does, each kept as .orig; a second time is refused, as is a split of nothing."""
    for name in ("repo", "mine"):
        description = crlf_latin().write(tmp_path / name)
    subprocess.run(["git", "init", "-q"], cwd=tmp_path / "repo", check=True)
    assert run_cli("simulate", description, "-o", "m.csv", "--sensor", "pose:l2", "--poses", 3).code == 0
    assert run_cli("apply", tmp_path / "repo/urdf/arm.urdf.xacro", "m_truth.yaml", "--format", "xacro", "-o", "a.patch").code == 0
    subprocess.run(["git", "apply", "../a.patch"], cwd=tmp_path / "repo", check=True)

    words = ("apply", description, "m_truth.yaml", "--format", "xacro", "-o", "b.patch")
    assert "--format xacro alone" in run_cli("apply", description, "m_truth.yaml", "-o", "c.urdf", "--split").err
    assert "each kept as .orig" in run_cli(*words, "--in-place", "--xacro-folder", "out").out
    for way, before in crlf_latin().files.items():
        assert (tmp_path / "mine" / f"{way}.orig").read_bytes() == before
        content = (tmp_path / "mine" / way).read_bytes()
        assert content == (tmp_path / "repo" / way).read_bytes() == (tmp_path / "out" / Path(way).name).read_bytes() != before
    again = run_cli(*words, "--overwrite")
    assert (again.code, "already calibrated" in again.err) == (2, True)


@pytest.mark.usefixtures("in_process")
def test_a_fit_says_beforehand_what_becomes_of_the_sources(
    tmp_path: Path, run_cli: Callable[..., CliResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sources that cannot take what a fit would find are refused, and those that will change are named, before anything is fitted."""

    def fitted(*_: object, **__: object) -> None:
        raise UsageError("fitted")

    monkeypatch.setattr("urdfcal.api.fit", fitted)
    description = twice().write(tmp_path / "legs")
    assert run_cli("simulate", description, "-o", "m.csv", "--sensor", "pose:left_foot", "--poses", 3).code == 0
    words = ("fit", description, "m.csv", "--format", "xacro")
    assert "cannot be calibrated in its sources" in run_cli(*words).err
    split = run_cli(*words, "--split").err.splitlines()
    assert split[-2:] == ["the calibration goes into urdf/arm.urdf.xacro", "urdfcal: fitted"]


@pytest.mark.usefixtures("in_process")
def test_installed_files_are_copied_and_never_changed_in_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A vendor's package is patched as new files, which is said, and --in-place is refused."""
    vendor = tmp_path / "vendor" / "share" / "legs"
    vendor.mkdir(parents=True)
    (vendor / "package.xml").write_text("<package><name>legs</name></package>")
    text = twice().files["urdf/arm.urdf.xacro"].decode().replace('  <xacro:leg side="left"/>\n', "")
    (vendor / "leg.xacro").write_text(text)
    mine = tmp_path / "mine.urdf.xacro"
    mine.write_text(text.split("  <xacro:macro")[0] + '<xacro:include filename="$(find legs)/leg.xacro"/>\n</robot>\n')
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "vendor"))
    robot = load_robot(mine)
    patch = Deployed(robot, shaken(robot)).sources()
    assert b"new file mode 100644\n--- /dev/null\n+++ b/legs/leg.xacro\n" in patch.unified
    assert any("is installed, and not yours" in warning for warning in patch.warnings)
    with pytest.raises(RobotError, match="not changed in place"):
        _ = patch.in_place


def test_a_plain_urdf_and_names_of_other_kinds_are_refused(tmp_path: Path) -> None:
    """The format is for sources that xacro expands, and is written to a patch."""
    place = tmp_path / "arm.urdf"
    place.write_text('<robot name="a"><link name="base"/>' + joint("j", "base", "tip", "<origin/>") + "</robot>")
    plan = deployment(["xacro"], None, "arm")
    assert plan.main == Path("arm_xacro.patch")
    with pytest.raises(RobotError, match="plain URDF"):
        plan.require_fit_for(load_robot(place), ["j"])
    with pytest.raises(UsageError, match="writes a patch"):
        deployment(["xacro"], Path("arm.yaml"), "arm")
