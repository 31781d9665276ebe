"""Packages are found without ROS."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import urdfcal
from tests.support.paths import ROBOTS_DIR
from urdfcal.base.errors import RobotError
from urdfcal.cli.inputs import papers_arm
from urdfcal.robot.packages import find_package, is_at_home, resolve_uri


@pytest.fixture(autouse=True)
def _no_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)


def package(folder: Path, name: str, declared: str | None = None) -> Path:
    place = folder / name
    place.mkdir(parents=True)
    if declared is not None:
        (place / "package.xml").write_text(f"<package><name> {declared} </name></package>")
    return place


def test_package_dir_may_hold_the_package_or_be_it(tmp_path: Path) -> None:
    """--package-dir names the folder above a package, or the package itself."""
    place = package(tmp_path, "arm_description")
    assert find_package("arm_description", [tmp_path]) == place
    assert find_package("arm_description", [place]) == place


def test_the_name_in_package_xml_counts(tmp_path: Path) -> None:
    """A package is known by its package.xml up to three folders below, whatever its folder is called."""
    place = package(tmp_path, "src/vendor/checkout-2", "arm_description")
    assert find_package("arm_description", [tmp_path]) == place
    assert find_package("arm_description", [place]) == place


def test_ros_package_path_is_searched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every entry of ROS_PACKAGE_PATH is searched; empty and missing ones do no harm."""
    place = package(tmp_path / "b", "arm_description")
    monkeypatch.setenv("ROS_PACKAGE_PATH", os.pathsep.join(["", str(tmp_path / "nope"), str(tmp_path / "b")]))
    assert find_package("arm_description") == place


def test_ament_prefix_path_is_searched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package under AMENT_PREFIX_PATH lies in its prefix's share folder."""
    place = package(tmp_path, "share/arm_description")
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join([str(tmp_path / "nope"), str(tmp_path)]))
    assert find_package("arm_description") == place


@pytest.mark.parametrize("name", ["example-robot-data", "tiago_description"])
def test_the_prefix_of_pip_is_searched(name: str) -> None:
    """example-robot-data and its robots are found where pip put them."""
    assert find_package(name).name == name


def test_the_users_folder_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """--package-dir beats ROS_PACKAGE_PATH, which beats AMENT_PREFIX_PATH, which beats pip's prefix."""
    places = [package(tmp_path, f"{where}/tiago_description") for where in ("user", "ros", "ament/share")]
    found = []
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ament"))
    found.append(find_package("tiago_description"))
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros"))
    found.append(find_package("tiago_description"))
    found.append(find_package("tiago_description", [tmp_path / "user"]))
    assert found[::-1] == places


def test_package_xml_that_cannot_be_read_is_passed_over(tmp_path: Path) -> None:
    """Broken package.xml files in a workspace do not stop the search."""
    for index, text in enumerate([b"", b"<package>", b"<package/>", b"<?xml version='1.0' encoding='nope'?><package/>"]):
        (package(tmp_path, f"p{index}") / "package.xml").write_bytes(text)
    place = package(tmp_path, "z", "arm_description")
    assert find_package("arm_description", [tmp_path]) == place


def test_package_xml_that_is_no_file_or_huge_is_not_read(tmp_path: Path) -> None:
    """A pipe would be waited for without end."""
    os.mkfifo(package(tmp_path, "p0") / "package.xml")
    (package(tmp_path, "p1") / "package.xml").symlink_to("/dev/zero")
    with (package(tmp_path, "p2") / "package.xml").open("wb") as file:
        file.truncate(10**12)
    place = package(tmp_path, "z", "arm_description")
    assert find_package("arm_description", [tmp_path]) == place


def test_what_is_at_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Below the description's folder and packages where they are looked for; links are followed first, `..` after them."""
    source, workspace, elsewhere = (tmp_path / name for name in ("robot", "workspace", "elsewhere"))
    place = package(workspace, "arm_description")
    for file in (source / "urdf" / "a.stl", place / "b.stl", elsewhere / "sub" / "c.stl", elsewhere / "d.stl"):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    (source / "urdf" / "link").symlink_to(elsewhere / "sub")
    description = source / "urdf" / "arm.urdf"
    assert is_at_home(source / "urdf" / "a.stl", description)
    assert is_at_home(place / "b.stl", description, [workspace])
    assert not is_at_home(place / "b.stl", description)
    assert not is_at_home(source / "urdf" / "link" / "c.stl", description)
    (source / "urdf" / "d.stl").touch()
    assert not is_at_home(source / "urdf" / "link" / ".." / "d.stl", description)  # elsewhere/d.stl to the system
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(workspace))
    assert is_at_home(place / "b.stl", description)
    with pytest.raises(OSError, match="none"):
        is_at_home(source / "none.stl", description)


def test_a_package_that_is_a_link_is_told_by_its_name(tmp_path: Path) -> None:
    """A workspace of links to packages is usual; one to any other folder makes nothing of it the robot's own."""
    for name, declared in (("arm", "arm"), ("private", None)):
        (package(tmp_path / "elsewhere", name, declared) / "a.stl").touch()
        (tmp_path / "workspace").mkdir(exist_ok=True)
        (tmp_path / "workspace" / name).symlink_to(tmp_path / "elsewhere" / name)
        found = find_package(name, [tmp_path / "workspace"])
        assert is_at_home(found / "a.stl", tmp_path / "x" / "arm.urdf", [tmp_path / "workspace"], name) == (declared is not None)


def test_a_package_that_is_nowhere_is_refused_with_the_way_out(tmp_path: Path) -> None:
    """The message names the package and the option to set."""
    with pytest.raises(RobotError, match=r"package 'nope_description' was not found; .*--package-dir.*ROS_PACKAGE_PATH"):
        find_package("nope_description", [tmp_path])


@pytest.mark.parametrize("beside", ["urdfcal", "."], ids=["installed", "checkout"])
def test_our_own_macros_are_in_the_package_or_beside_it(beside: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Installed, robots/ is in the package; in a checkout it is beside it; no folder of that name in a workspace is taken for it."""
    package(tmp_path / "workspace", "urdfcal", None)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "workspace"))
    monkeypatch.setattr(urdfcal, "__file__", str(tmp_path / "urdfcal" / "__init__.py"))
    (tmp_path / "urdfcal").mkdir()
    with pytest.raises(RobotError, match=r"neither in .*urdfcal nor beside it; install urdfcal again"):
        find_package("urdfcal")
    (tmp_path / beside / "robots").symlink_to(ROBOTS_DIR)
    assert find_package("urdfcal") == tmp_path / beside
    assert papers_arm("arm7") == tmp_path / beside / "robots" / "arm7" / "arm7.urdf.xacro"


@pytest.mark.parametrize("name", ["", ".", "..", "../etc", "a/b"])
def test_only_names_are_looked_for(tmp_path: Path, name: str) -> None:
    """What is no name cannot lead out of the package folders."""
    with pytest.raises(RobotError, match="is no name of a package"):
        find_package(name, [tmp_path])


def test_uris_become_paths(tmp_path: Path) -> None:
    """package://pkg/path lies in the package, also with the third slash that some write; anything else stays as it is."""
    place = package(tmp_path, "arm_description")
    for uri in ("package://arm_description/urdf/a.xacro", "package:///arm_description/urdf/a.xacro"):
        assert resolve_uri(uri, [tmp_path]) == str(place / "urdf" / "a.xacro")
    assert resolve_uri("urdf/a.xacro", [tmp_path]) == "urdf/a.xacro"
