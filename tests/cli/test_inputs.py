"""What a command line does not name is found: the arm of the paper, wherever urdfcal itself is."""

from __future__ import annotations

from pathlib import Path

import pytest

import urdfcal
from tests.support.paths import ROBOTS_DIR
from urdfcal.base.errors import UsageError
from urdfcal.cli.inputs import arm7_file


@pytest.mark.parametrize("beside", ["urdfcal", "."], ids=["installed", "checkout"])
def test_the_arm_is_in_the_package_or_beside_it(beside: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Installed, the robots are in the package; in a checkout they are in the folder that it is in."""
    monkeypatch.setattr(urdfcal, "__file__", str(tmp_path / "urdfcal" / "__init__.py"))
    (tmp_path / "urdfcal").mkdir()
    (tmp_path / beside / "robots").symlink_to(ROBOTS_DIR)
    assert arm7_file() == tmp_path / beside / "robots" / "arm7" / "arm7.urdf.xacro"


def test_an_arm_that_is_nowhere_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the robots the message says where they were sought, and what to do."""
    monkeypatch.setattr(urdfcal, "__file__", str(tmp_path / "urdfcal" / "__init__.py"))
    with pytest.raises(UsageError, match=r"neither in .*urdfcal nor beside it; name the arm's file"):
        arm7_file()
