"""Make the README's pictures again: docs/view.png and docs/report.png. The measurements are simulated.

python -m tests.benchmarks.pictures
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import cv2

import urdfcal
from tests.benchmarks.view import simulated
from tests.support.browser import Browser, Picture

ROOT = Path(__file__).parents[2]
ARM7 = ROOT / "robots" / "arm7"
WIDTH = 1200  # pixels of a picture


def view_picture(browser: Browser, folder: Path) -> Picture:
    """A Panda before and after its calibration, with all of the page around the scene."""
    robot = urdfcal.load_robot(ROOT / "robots" / "panda" / "panda.urdf.xacro")
    urdfcal.fit(robot, simulated(robot, 40)).show().write_html(folder / "view.html")
    browser.resize(1440, 810, WIDTH / 1440)
    browser.open(folder / "view.html")
    return browser.picture()


def report_picture(browser: Browser, folder: Path) -> Picture:
    """The top of the report of the README's first command."""
    words = [sys.executable, "-m", "urdfcal.cli", "fit", ARM7 / "arm7.urdf.xacro", ARM7 / "measurements.csv", "--report", "r.html"]
    subprocess.run(words, cwd=folder, check=True, capture_output=True)
    browser.resize(1100, 900, WIDTH / 1100)
    browser.open(folder / "r.html", ready="document.readyState === 'complete' ? 1 : 0")
    return browser.picture()


def save(path: Path, picture: Picture) -> None:
    """As PNG, and say how large it is."""
    path.parent.mkdir(exist_ok=True)
    cv2.imwrite(str(path), picture[:, :, ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])
    print(f"{path.relative_to(ROOT)}: {picture.shape[1]} x {picture.shape[0]}, {path.stat().st_size / 1e3:.0f} kB")


def main() -> None:
    """Both pictures."""
    with tempfile.TemporaryDirectory() as scratch, Browser() as browser:
        save(ROOT / "docs" / "view.png", view_picture(browser, Path(scratch)))
        save(ROOT / "docs" / "report.png", report_picture(browser, Path(scratch)))


if __name__ == "__main__":
    main()
