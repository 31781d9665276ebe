"""The order of the house: imports go down only, heavy things come late, only the command line prints."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from graphlib import CycleError, TopologicalSorter

import pytest

from tests.support.paths import ROOT

PACKAGE = ROOT / "urdfcal"
FLOORS = (
    "base",
    "estimation",
    "robot",
    "model",
    "sensors",
    "calibration",
    "simulation",
    "planning",
    "vision",
    "deploy",
    "output",
    "fleet",
    "cell",
    "api",
    "cli",
    "__main__",
)
FILES = {path.relative_to(PACKAGE.parent).with_suffix("").as_posix().replace("/", "."): path for path in sorted(PACKAGE.rglob("*.py"))}
MODULES = {name: path for name, path in FILES.items() if path.name != "__init__.py"}


def imported_modules(name: str) -> set[str]:
    """Our own modules that a module imports anywhere in its text, also under TYPE_CHECKING and inside functions."""
    tree = ast.parse(MODULES[name].read_text("utf-8"))
    found = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module}
    found |= {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    return {module for module in found if module.startswith("urdfcal.")}


def floor(name: str) -> int:
    """The floor that a module stands on."""
    return FLOORS.index(name.split(".")[1])


@pytest.mark.parametrize("name", MODULES)
def test_imports_go_down_only(name: str) -> None:
    """A module imports from its own package and from those that stand before it."""
    assert {other for other in imported_modules(name) if floor(other) > floor(name)} == set()


@pytest.mark.parametrize("package", FLOORS)
def test_no_circles_inside_a_package(package: str) -> None:
    """The modules of a package can be put in an order in which each imports only those before it."""
    own = [name for name in MODULES if name.split(".")[1] == package]
    try:
        TopologicalSorter({name: imported_modules(name) & set(own) for name in own}).prepare()
    except CycleError as circle:
        pytest.fail(" -> ".join(circle.args[1]))


def test_every_package_is_installed() -> None:
    """`pyproject.toml` lists each of them; what it forgets works in a checkout and nowhere else."""
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]["packages"]
    there = {name.removesuffix(".__init__") for name, path in FILES.items() if path.name == "__init__.py"}
    assert set(listed) - {"urdfcal.robots"} == there


def test_only_the_command_line_prints() -> None:
    """No module but the command line's own print."""
    printing = [name for name, path in MODULES.items() if re.search(r"(?<![\w.])print\(", path.read_text("utf-8"))]
    assert set(printing) <= {"urdfcal.cli.main", "urdfcal.cli.run", "urdfcal.cli.console"}


@pytest.mark.parametrize("statement", ["import urdfcal", "import urdfcal.cli.main"])
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
import urdfcal, urdfcal.output.text.result, urdfcal.calibration.analysis.validation, urdfcal.output.report.files
from urdfcal.model.gauge import build_error_model
from urdfcal.simulation.readings import ReadingNoise, simulate_readings
from urdfcal.simulation.setup import parse_sensors, seen_with, simulated_setup
arm = urdfcal.load_robot({str(PACKAGE.parent / "robots" / "arm7" / "arm7.urdf.xacro")!r})
data = urdfcal.read_measurements({str(PACKAGE.parent / "robots" / "arm7" / "measurements.csv")!r}, arm)
urdfcal.fit(arm, data).report()
urdfcal.fit(arm, data.with_spots(data.spots, np.full_like(data.sigma, 1e-4))).report()
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


def words_of_sensors() -> set[str]:
    """Names of sensors and of their noise, and the units that people read them in."""
    from urdfcal.sensors.registry import SENSORS
    from urdfcal.sensors.sensor import UNITS

    return {*SENSORS, *(sensor.noise for sensor in SENSORS.values()), *UNITS}


ASKS_BY_NAME = {
    "urdfcal.model.options": "priors in a file are in mm or deg",
    "urdfcal.calibration.rig_file": "the squares of a board are in mm or m",
    "urdfcal.cli.measured": "--spot-sigma-mm is the spots' own",
    "urdfcal.vision.bench.beams": "columns of a bench are in mm or m",
    "urdfcal.output.view.screen": "a node of the scene is called so",
    "urdfcal.output.view.key_frames": "figures in mm go first",
}


def constants_asked_for(node: ast.AST) -> set[str]:
    """Strings that something is compared with or looked up by."""
    if isinstance(node, ast.Compare):
        asked: list[ast.AST] = [node.left, *node.comparators]
    elif isinstance(node, ast.Subscript):
        asked = [node.slice]
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in ("get", "pop"):
        asked = list(node.args[:1])
    elif isinstance(node, ast.MatchValue):
        asked = [node.value]
    else:
        return set()
    every = [each for one in asked for each in (one.elts if isinstance(one, ast.Tuple | ast.List | ast.Set) else [one])]
    return {each.value for each in every if isinstance(each, ast.Constant) and isinstance(each.value, str)}


def asks_which_sensor(name: str) -> set[str]:
    """What a module asks for by a sensor's name, its unit or its class."""
    from urdfcal.sensors.registry import SENSORS

    tree = ast.parse(MODULES[name].read_text("utf-8"))
    names = {word for node in ast.walk(tree) for word in constants_asked_for(node)} & words_of_sensors()
    classes = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    return names | classes & {type(sensor).__name__ for sensor in SENSORS.values()}


def test_only_sensors_know_which_sensor_it_is() -> None:
    """Outside `sensors` no module compares or looks up by a sensor's name or unit: it asks the sensor, or the measurements."""
    asking = {name: found for name in MODULES if ".sensors." not in name and (found := asks_which_sensor(name))}
    assert {name: found for name, found in asking.items() if name not in ASKS_BY_NAME} == {}
    assert set(asking) == set(ASKS_BY_NAME)


@pytest.mark.parametrize(
    "line", ["x.sensor == 'spot'", "if x.name in ('pixel', 'point'): pass", "x.unit != 'deg'", "kinds['orientation']", "a.get('socket')"]
)
def test_asking_by_name_is_seen(line: str) -> None:
    """The test above sees comparisons and look-ups."""
    assert {word for node in ast.walk(ast.parse(line)) for word in constants_asked_for(node)} & words_of_sensors()
