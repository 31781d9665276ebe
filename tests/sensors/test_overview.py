"""What is understood of a file of measurements."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from tests.conftest import CliResult
from tests.support.small_robot import URDF


def test_the_corners_of_a_board_are_one_line(run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """Of twelve corners and one other target there are two lines: how many corners, and what was read of all of them."""
    (tmp_path / "small.urdf").write_text(URDF)
    (tmp_path / "rig.yaml").write_text("boards: {tool: '4x3:40mm'}\n")
    (tmp_path / "camera.yaml").write_text("size_px: [640, 480]\nintrinsics: {fx: 500, fy: 500, cx: 320, cy: 240}\n")
    corners = [f"tool:{corner}.{axis}" for corner in range(12) for axis in "uv"]
    rows = [[f"{0.1 * row}", "0.1", "0.05", "77", "99", *[f"{100 + row}"] * 22, *(["", ""] if row else ["5", "6"])] for row in range(3)]
    (tmp_path / "m.csv").write_text("\n".join(",".join(row) for row in [["turn", "lift", "slide", "upper.u", "upper.v", *corners], *rows]))
    done = run_cli("measurements", "small.urdf", "m.csv", "--rig", "rig.yaml", "--camera", "camera.yaml")
    assert done.code == 0, done.err
    assert re.search(r"tool, 12 corners +34 spots or targets in pictures +\.u \.v +\(px\)", done.out), done.out
    assert re.search(r"upper +3 spots", done.out)
    assert "tool:" not in done.out


def test_spots_in_pixels_want_a_camera_that_knows_the_screen(run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """Where it knows none, that is said with the way out, in one line."""
    (tmp_path / "small.urdf").write_text(URDF)
    (tmp_path / "camera.yaml").write_text("size_px: [640, 480]\nintrinsics: {fx: 500, fy: 500, cx: 320, cy: 240}\n")
    (tmp_path / "m.csv").write_text("turn,lift,slide,laser_1.u,laser_1.v\n0,0,0.1,300,200\n0.1,0,0.1,310,200\n")
    done = run_cli("measurements", "small.urdf", "m.csv", "--camera", "camera.yaml")
    assert done.code == 2
    assert "the camera knows no screen; add it with" in done.err
