"""Pictures of parameters: how they came to rest, as in the paper's Fig. 4, and how well they are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.base.terminal import displayed
from urdfcal.calibration.result import FitResult
from urdfcal.model.parameters import INSTRUMENTS, Parameter
from urdfcal.output.report.plots.axes import DASHES, Axes, Look
from urdfcal.output.report.plots.marks import DOT, RING
from urdfcal.output.report.plots.svg import Picture, draw_picture, look_of, row_ends, row_height, sane
from urdfcal.output.text.instruments import first_kind

_MOST_SWEEPS = 200
_FEW_SWEEPS = 40
_MOST_NAMED = 24  # lines that a legend can hold
_INTERVAL = 1.96  # sigmas that hold the truth 95 times in 100
_GROUPS = {
    "joint": "Joint",
    "mount": "Mount",
    "screen": "Screen",
    "beam": "Beam",
    "reference": "Measuring frame",
    "target": "Target",
    "camera": "Camera",
    "lens": "Lens",
}
_TITLES = {
    "d_a": "(a) Link lengths a",
    "d_d": "(b) Link offsets d",
    "d_alpha": "(c) Twists alpha and beta",
    "d_beta": "(c) Twists alpha and beta",
    "d_theta": "(d) Joint angles theta",
    "d_q": "Zeros of sliding joints",
}


def convergence_pictures(calibration: FitResult) -> list[Picture]:
    """The estimates against the sweep; (a) to (d) are the paper's panels, mount and screen have their own; and the residual."""
    history, parameters = calibration.estimate.history, calibration.errors.parameters
    kept = _kept(len(history))
    states, numbers = np.array([history[sweep].x for sweep in kept]), frame_numbers(parameters)
    found = []
    for title, columns in _panels(parameters).items():
        unit, size = displayed(parameters[columns[0]].unit)
        lines = _lines([parameters[column] for column in columns], title, numbers)
        caption = "Against the start in closed form." if parameters[columns[0]].kind in INSTRUMENTS else ""
        found.append(_history(title, caption, unit, kept, sane(states[:, columns] / size), lines))
    what, unit, size = first_kind(calibration)
    rms = sane(np.array([[history[sweep].residual_rms / size] for sweep in kept]))
    return [*found, _history(f"RMS of {what}", "", unit, kept, rms, [("", Look("ink", DOT, "solid"))], log=True)] if rms.any() else found


def frame_numbers(parameters: Sequence[Parameter]) -> dict[str, int]:
    """A number for every joint and link with errors, by which all pictures have the same colour and mark for it; joints come first."""
    joints = [_owner(parameter) for parameter in parameters if parameter.kind == "joint"]
    return {name: number for number, name in enumerate(dict.fromkeys([*joints, *map(_owner, parameters)]))}


def _owner(parameter: Parameter) -> str:
    """`joint1` of `joint1.d_a`."""
    return parameter.name.rpartition(".")[0]


def _lines(parameters: Sequence[Parameter], title: str, numbers: Mapping[str, int]) -> list[tuple[str, Look]]:
    """Label and look of each line of a panel: colour and mark are its frame's, the dash tells the frame's parameters apart."""
    found, own = [], dict[str, int]()
    for parameter in parameters:
        colour, mark = look_of(numbers[_owner(parameter)])
        dash = own[_owner(parameter)] = own.get(_owner(parameter), -1) + 1
        label = _short(parameter, title) if len(parameters) <= _MOST_NAMED else ""
        found.append((label, Look(colour, mark, DASHES[dash % len(DASHES)], 1.2)))
    return found


def value_pictures(calibration: FitResult) -> list[Picture]:
    """Every parameter with its 95 % interval, lengths and angles apart."""
    found = []
    for unit_si, noun in (("m", "Lengths"), ("rad", "Angles")):
        own = enumerate(calibration.errors.parameters)
        rows = [row for row, parameter in own if parameter.unit == unit_si and parameter.kind not in INSTRUMENTS]
        if rows:
            unit, _ = displayed(unit_si)
            title, caption = f"{noun} and their sigmas", f"Estimates with 95 % intervals, in {unit}; the band is the prior's."
            caption += (
                " Hollow: not determined by the data." if not all(calibration.identifiability.determined[row] for row in rows) else ""
            )
            found.append(draw_picture("parameters", title, caption, row_height(len(rows)), _Values(calibration, rows).draw))
    return found


def _kept(sweeps: int) -> list[int]:
    """Which of many sweeps are drawn: all at first, then ever fewer."""
    if sweeps <= _MOST_SWEEPS:
        return list(range(sweeps))
    return sorted({int(sweep) - 1 for sweep in np.geomspace(1, sweeps, _MOST_SWEEPS)})


def _panels(parameters: Sequence[Parameter]) -> dict[str, list[int]]:
    """Columns of the state by the panel in which they are drawn."""
    panels: dict[str, list[int]] = {title: [] for title in _TITLES.values()}
    for column, parameter in enumerate(parameters):
        if parameter.kind == "place":  # sockets and planes are many, and nobody's errors
            continue
        panels.setdefault(_title(parameter), []).append(column)
    return {title: columns for title, columns in panels.items() if columns}


def _title(parameter: Parameter) -> str:
    last = parameter.name.rsplit(".", 1)[-1]
    motion = "translations" if parameter.unit == "m" else "rotations"
    return _TITLES.get(last, f"{_GROUPS.get(parameter.kind, parameter.kind.capitalize())} {motion}")


def _short(parameter: Parameter, title: str) -> str:
    """The name without what the panel's title says already."""
    first, _, last = parameter.name.rpartition(".")
    if last in ("d_alpha", "d_beta"):
        return f"{first} {last.removeprefix('d_')}"
    return first if title == _TITLES.get(last) else parameter.name


def _history(
    title: str, caption: str, unit: str, sweeps: Sequence[int], values: Matrix, lines: Sequence[tuple[str, Look]], log: bool = False
) -> Picture:
    def draw(axes: Axes) -> None:
        for (label, look), line in zip(lines, values.T, strict=True):
            axes.points(np.array(sweeps), line, look, label)
        axes.x_label, axes.y_label, axes.whole = "sweep", f"in {unit}", True
        if log and 0 < 10 * np.nanmin(values, initial=np.inf) < np.nanmax(values, initial=0.0):
            axes.y_kind, axes.y_ends = "log", (0.8 * float(np.nanmin(values)), 1.25 * float(np.nanmax(values)))
        many = sweeps[-1] >= _FEW_SWEEPS
        axes.x_kind, axes.x_ends = ("symlog" if many else "linear"), (0.0 if many else -0.3, max(sweeps[-1], 1) * 1.03)

    return draw_picture("convergence", title, caption, 130, draw)


@dataclass(frozen=True)
class _Values:
    calibration: FitResult
    rows: list[int]

    def draw(self, axes: Axes) -> None:
        errors, place = self.calibration.errors, -np.arange(len(self.rows), dtype=float)
        unit, size = displayed(errors.parameters[self.rows[0]].unit)
        value, sigma = (sane(each[self.rows] / size) for each in (self.calibration.x, self.calibration.sigma))
        prior, mean = sane(errors.sigma[self.rows] / size), errors.mean[self.rows] / size
        seen = np.array(self.calibration.identifiability.determined)[self.rows]
        interval = _INTERVAL * np.where(seen, sigma, 0.0)
        low, high = float(np.nanmin(value - interval, initial=0.0)), float(np.nanmax(value + interval, initial=1e-9))
        axes.x_ends = (low - 0.06 * (high - low), high + 0.06 * (high - low))
        axes.bars(mean - _INTERVAL * prior, mean + _INTERVAL * prior, place, "band")
        axes.across(x=0.0)
        self._draw_intervals(axes, place, value, _INTERVAL * sigma)
        axes.rows = [errors.names[row] for row in self.rows]
        axes.x_label, axes.y_ends = f"in {unit}", row_ends(len(self.rows))

    def _draw_intervals(self, axes: Axes, place: Vector, value: Vector, half: Vector) -> None:
        """Each in the colour of its joint; a flat end is a short upright line."""
        numbers, end = frame_numbers(self.calibration.errors.parameters), 0.25 * np.array([0, 0, np.nan, 1, -1, np.nan, 1, -1])
        for row, at, middle, far in zip(self.rows, place, value, half, strict=True):
            colour, _ = look_of(numbers[_owner(self.calibration.errors.parameters[row])])
            steps = np.array([-1, 1, np.nan, -1, -1, np.nan, 1, 1])
            axes.points(middle + far * steps, at + end, Look(colour, dash="solid", width=1.2))
            known = self.calibration.identifiability.determined[row]
            axes.points(np.array([middle]), np.array([at]), Look(colour, DOT if known else RING))
