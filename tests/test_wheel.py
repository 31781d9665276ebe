"""What is installed: the macros of robots/ where urdfcal's own xacro finds them, and where ROS's does."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from tests.support.paths import ROOT

CELL = """<robot name="cell" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="$(find urdfcal)/robots/slm.urdf.xacro"/>
<link name="base"/><link name="tool"/><joint name="j" type="continuous"><parent link="base"/><child link="tool"/><axis xyz="0 0 1"/></joint>
<xacro:slm parent="tool"/><xacro:screen parent="base" xyz="1 0 0"/></robot>"""
AMENT = """import os
def get_package_share_directory(name):
    for prefix in os.environ["AMENT_PREFIX_PATH"].split(os.pathsep):
        if os.path.exists(os.path.join(prefix, "share/ament_index/resource_index/packages", name)):
            return os.path.join(prefix, "share", name)
    raise LookupError(name)
"""  # what ament_index_python, which is not on PyPI, does


@pytest.mark.slow
def test_a_wheel_has_the_macros_for_both_kinds_of_xacro(tmp_path: Path) -> None:
    """Unpacked as pip does, `$(find urdfcal)` leads to them from any folder, in urdfcal and in ROS's own xacro."""
    source = tmp_path / "source"
    shutil.copytree(ROOT, source, ignore=shutil.ignore_patterns(".git", ".venv", "build", "*.egg-info", "__pycache__"))
    subprocess.run([sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", tmp_path, source], check=True)
    (wheel,) = tmp_path.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    (tmp_path / "cell.urdf.xacro").write_text(CELL)
    (tmp_path / "ament" / "ament_index_python").mkdir(parents=True)
    (tmp_path / "ament" / "ament_index_python" / "packages.py").write_text(AMENT)
    (data,) = (tmp_path / "site").glob("*.data/data")
    ros = os.environ | {"PYTHONPATH": str(tmp_path / "ament"), "AMENT_PREFIX_PATH": str(data)}
    by_ros = subprocess.run(
        [sys.executable, "-c", "import xacro; xacro.main()", "cell.urdf.xacro"],
        cwd=tmp_path,
        env=ros,
        capture_output=True,
        text=True,
        check=True,
    )
    code = "import sys; import urdfcal; robot = urdfcal.load_robot('cell.urdf.xacro'); print(urdfcal.__file__, robot.rig.lasers)"
    own = os.environ | {"PYTHONPATH": str(tmp_path / "site")}
    by_us = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=own, capture_output=True, text=True, check=True)
    assert '<link name="laser_2">' in by_ros.stdout
    assert by_us.stdout.split(maxsplit=1) == [str(tmp_path / "site" / "urdfcal" / "__init__.py"), "('laser_1', 'laser_2')\n"]
