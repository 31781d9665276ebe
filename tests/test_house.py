"""The order of the house: imports go down only, heavy things come late, every module is in the README."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "urdfcal"
README = (PACKAGE.parent / "README.md").read_text("utf-8")
FLOORS = [
    (int(floor), name)
    for floor, files in re.findall(r"^\| (\d) \| (.*?) \|", README, re.MULTILINE)
    for name in re.findall(r"`([\w/]+)\.py`", files)
]
ORDER = {name: index for index, (_, name) in enumerate(FLOORS)}
MODULES = sorted(path.relative_to(PACKAGE).with_suffix("").as_posix() for path in PACKAGE.rglob("*.py") if path.name != "__init__.py")


def imported_modules(name: str) -> set[str]:
    """Our own modules that a module imports anywhere in its text, also under TYPE_CHECKING and inside functions."""
    tree = ast.parse((PACKAGE / f"{name}.py").read_text("utf-8"))
    found = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module}
    found |= {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    return {module.removeprefix("urdfcal.").replace(".", "/") for module in found if module.startswith("urdfcal.")}


def test_every_module_has_a_line_in_the_readme() -> None:
    """The README's table of files names every module once, floor by floor."""
    assert sorted(ORDER) == MODULES
    assert [floor for floor, _ in FLOORS] == sorted(floor for floor, _ in FLOORS)


@pytest.mark.parametrize("name", MODULES)
def test_imports_go_down_only(name: str) -> None:
    """A module imports from lower floors, or from its own floor what is listed above it."""
    upward = {other for other in imported_modules(name) if ORDER[other] >= ORDER[name]}
    assert upward == set()


def test_only_the_command_line_prints() -> None:
    """No module but the command line's own calls print."""
    printing = [
        name
        for name in MODULES
        if name not in ("cli", "commands/console") and re.search(r"(?<![\w.])print\(", (PACKAGE / f"{name}.py").read_text("utf-8"))
    ]
    assert printing == []


@pytest.mark.parametrize("statement", ["import urdfcal", "import urdfcal.cli"])
def test_start_up_loads_nothing_heavy(statement: str) -> None:
    """Importing the package or its command line loads neither Pinocchio nor NumPy nor anything slow."""
    heavy = {"pinocchio", "numpy", "scipy", "cv2", "matplotlib", "meshcat", "yourdfpy", "lxml"}
    code = f"{statement}; import sys; print(*sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


FITS = f"""
import sys
from dataclasses import replace
import numpy as np
import urdfcal, urdfcal.report, urdfcal.validation, urdfcal.extras, urdfcal.reporting.report_files
from urdfcal.gauge import build_error_model
from urdfcal.reading_simulation import ReadingNoise, simulate_readings
from urdfcal.simulated_setup import parse_sensors, seen_with, simulated_setup
arm = urdfcal.load_robot({str(PACKAGE.parent / "robots" / "arm7" / "arm7.urdf.xacro")!r})
data = urdfcal.read_measurements({str(PACKAGE.parent / "robots" / "arm7" / "measurements.csv")!r}, arm)
urdfcal.fit(arm, data).report()
urdfcal.fit(arm, replace(data, sigma=np.full_like(data.sigma, 1e-4))).report()
sensors, lasers = parse_sensors(["point:slm"], arm, 1)
seen = seen_with(arm, sensors, "", lasers)
errors = build_error_model(seen.chain, seen.rig)
setup = simulated_setup(seen, errors, np.zeros(len(errors.names)), sensors, np.random.default_rng(0))
urdfcal.fit(arm, simulate_readings(setup, 40, np.random.default_rng(0), ReadingNoise(length=1e-4))).report()
print(*sorted({{"scipy", "cv2", "matplotlib", "meshcat", "yourdfpy"}} & set(sys.modules)))
"""


def test_an_ekf_fit_does_not_load_scipy() -> None:
    """The default road of `fit` stays off scipy, which takes longer to load than the fit takes; also with columns, and with points."""
    done = subprocess.run([sys.executable, "-c", FITS], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
