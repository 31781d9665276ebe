"""Pictures of parameters: how they came to rest, as in the paper's Fig. 4, and how well they are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from urdfcal.base.geometry import Matrix
from urdfcal.base.terminal import displayed
from urdfcal.calibration.result import FitResult
from urdfcal.model.parameters import INSTRUMENTS, Parameter
from urdfcal.output.report.plots.svg import BAND, DASHES, INK, MARKERS, SERIES, WIDE, Picture, draw_picture, sane
from urdfcal.output.text.instruments import first_kind

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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
    states = np.array([history[sweep].x for sweep in kept])
    found = []
    for title, columns in _panels(parameters).items():
        unit, size = displayed(parameters[columns[0]].unit)
        names = [_short(parameters[column], title) for column in columns]
        caption = f"Estimates after each sweep, in {unit}"
        caption += ", against the start in closed form." if parameters[columns[0]].kind in INSTRUMENTS else "."
        found.append(_history(title, caption, unit, kept, sane(states[:, columns] / size), names))
    what, unit, size = first_kind(calibration)
    rms = sane(np.array([[history[sweep].residual_rms / size] for sweep in kept]))
    return [*found, _history(f"RMS of {what}", "After each sweep.", unit, kept, rms, [""], log=True)] if rms.any() else found


def value_pictures(calibration: FitResult) -> list[Picture]:
    """Every parameter with its 95 % interval, lengths and angles apart."""
    found = []
    for unit_si, noun in (("m", "Lengths"), ("rad", "Angles")):
        own = enumerate(calibration.errors.parameters)
        rows = [row for row, parameter in own if parameter.unit == unit_si and parameter.kind not in INSTRUMENTS]
        if rows:
            unit, _ = displayed(unit_si)
            caption = f"Estimates with 95 % intervals, in {unit}; the band is the prior's. Hollow: not determined by the data."
            title, height = f"{noun} and their sigmas", 0.8 + 0.2 * len(rows)
            found.append(draw_picture("parameters", title, caption, height, _Values(calibration, rows).draw, WIDE))
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
    title: str, caption: str, unit: str, sweeps: Sequence[int], values: Matrix, names: Sequence[str], log: bool = False
) -> Picture:
    def draw(axes: Axes) -> None:
        for index, (name, line) in enumerate(zip(names, values.T, strict=True)):
            few = len(sweeps) <= _FEW_SWEEPS
            look: Any = {"marker": MARKERS[index % len(MARKERS)]} if few else {"linestyle": DASHES[index % len(DASHES)]}
            axes.plot(sweeps, line, **look, color=SERIES[index % len(SERIES)], label=name.lstrip("_") or "_none")
        axes.set(xlabel="sweep", ylabel=unit)
        if log and 0 < 10 * np.nanmin(values, initial=np.inf) < np.nanmax(values, initial=0.0):
            _logarithmic(axes)
        _count_sweeps(axes, len(sweeps))

    names = names if len(names) <= _MOST_NAMED else ["_none"] * len(names)
    return draw_picture("convergence", title, caption, 2.9, draw)


def _logarithmic(axes: Axes) -> None:
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _count_sweeps(axes: Axes, sweeps: int) -> None:
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    if sweeps <= _FEW_SWEEPS:
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    else:
        axes.set_xscale("symlog", linthresh=1)
        axes.set_xlim(left=0)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


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
        low, high = np.nanmin(value - interval, initial=0.0), np.nanmax(value + interval, initial=1e-9)
        axes.barh(place, 2 * _INTERVAL * prior, left=mean - _INTERVAL * prior, height=0.8, color=BAND)
        for flag, face in ((True, SERIES[0]), (False, "none")):
            own = seen == flag
            error = _INTERVAL * sigma[own]
            axes.errorbar(value[own], place[own], xerr=error, fmt="o", color=SERIES[0], markerfacecolor=face, markersize=3.5, capsize=2.5)
        axes.axvline(0, color=INK, linewidth=0.8)
        axes.set_yticks(place, [errors.names[row] for row in self.rows], fontsize=9.5)
        axes.set(xlabel=unit, ylim=(place[-1] - 0.8, 0.8))
        axes.set_xlim(low - 0.06 * (high - low), high + 0.06 * (high - low))
        axes.grid(False, axis="y")
