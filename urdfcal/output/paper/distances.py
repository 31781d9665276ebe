"""Tables II, III, VI and VII: distances of the spots before and after calibration."""

from __future__ import annotations

from collections.abc import Sequence

from urdfcal.base.geometry import Matrix
from urdfcal.output.paper.exhibit import HERE, PUBLISHED, RATIO, Exhibit, ratio
from urdfcal.output.report.document import Table
from urdfcal.simulation.paper import Line, Repeated
from urdfcal.simulation.published import SpotFigures

_FIGURES = ("mean", "std", "max")
_LASERS = ("l1", "l2")
_TRUE, _MEASURED = "the noise-free spot", "the measured spot, predicted from the readings"


def before_exhibit(repeated: Repeated) -> Exhibit:
    """Table II or VI."""
    number = "II" if repeated.study.section == 4 else "VI"
    lines = [line for line in repeated.lines if not line.estimator]
    return Exhibit(
        f"table-{number}",
        f"Table {number}: distances of the two spots before calibration",
        f"Distance from the nominal model's spot to {_TRUE}, in mm. {_how(repeated)}",
        _beside(lines, [line.to_true for line in lines], by_estimator=False),
        _own_words(repeated),
        lines=2,
    )


def after_exhibits(repeated: Repeated) -> list[Exhibit]:
    """Table III or VII for each protocol, the one nearest to what is published first, and for both distances."""
    found = []
    for protocol in reversed(list(repeated.study.protocols)):
        lines = [line for line in repeated.lines if line.protocol == protocol and line.published]
        if repeated.study.section == 4:
            found.append(_after(repeated, protocol, lines, [line.to_true for line in lines], _TRUE))
        found.append(_after(repeated, protocol, lines, [_measured(line) for line in lines], _MEASURED))
    return found


def stated_exhibit(repeated: Repeated) -> Exhibit:
    """What the paper does not have: the filter that is told how large the noise is, and at which end."""
    protocol = next(iter(repeated.study.protocols))
    lines = {name: [line for line in repeated.lines if (line.protocol, line.estimator) == (protocol, name)] for name in _EKFS}
    rows = [
        (*_place(line, laser), *_digits(line.to_true[laser]), *_digits(stated.to_true[laser]), _times(stated, line, laser))
        for line, stated in zip(*lines.values(), strict=True)
        for laser in range(len(_LASERS))
    ]
    return Exhibit(
        "noise-stated",
        "Beyond the paper: the filter that knows the noise",
        f"Distance to {_TRUE} in mm, {protocol} a pose. The EKF as published takes all spots as equally noisy; told how joints and spots "
        f"are read, it weighs each pose by how far a joint's noise throws its spots. The ratio is that of the means. {_draws(repeated)}",
        Table(
            ("case", "set", "laser", *_FIGURES, *_FIGURES, RATIO),
            tuple(rows),
            3,
            (("", 3), ("as published", 3), ("noise stated", 3), ("", 1)),
        ),
        lines=2,
    )


_EKFS = ("EKF", "EKF, noise stated")


def _after(repeated: Repeated, protocol: str, lines: Sequence[Line], ours: Sequence[Matrix], to: str) -> Exhibit:
    number, (first, *_) = "III" if repeated.study.section == 4 else "VII", to.split(",")
    return Exhibit(
        f"table-{number}-{protocol.replace(' ', '-')}-{first.split()[1]}",
        f"Table {number}, {protocol} a pose: after calibration, distance to {first}",
        f"Distance to {to}, in mm. {_how(repeated)}",
        _beside(lines, ours, by_estimator=True),
        _own_words(repeated),
        lines=2,
    )


def _beside(lines: Sequence[Line], ours: Sequence[Matrix], by_estimator: bool) -> Table:
    """Published and own figures, laser by laser."""
    rows = []
    for line, own in zip(lines, ours, strict=True):
        for laser in range(len(_LASERS)):
            theirs = _published(line)[laser]
            label = ((line.estimator,) if by_estimator else ()) + _place(line, laser)
            rows.append((*label, *_digits(theirs), *_digits(own[laser]), ratio(own[laser][0], theirs[0])))
    names = (("method",) if by_estimator else ()) + ("case", "set", "laser")
    groups = (("", len(names)), (PUBLISHED, 3), (HERE, 3), ("", 1))
    return Table((*names, *_FIGURES, *_FIGURES, RATIO), tuple(rows), len(names), groups)


def _place(line: Line, laser: int) -> tuple[str, str, str]:
    return str(line.case), line.poses, _LASERS[laser]


def _digits(figures: Sequence[float]) -> tuple[str, ...]:
    return tuple(f"{figure:.2f}" for figure in figures)


def _times(own: Line, other: Line, laser: int) -> str:
    return ratio(own.to_true[laser][0], other.to_true[laser][0])


def _published(line: Line) -> SpotFigures:
    assert line.published is not None
    return line.published


def _measured(line: Line) -> Matrix:
    assert line.to_measured is not None
    return line.to_measured


def _how(repeated: Repeated) -> str:
    return f"The ratio is that of the means. {_draws(repeated)}"


def _draws(repeated: Repeated) -> str:
    if repeated.runs == 1:
        return f"Here: one draw of poses and noise, seed {repeated.seed}."
    return f"Here: mean of each figure over {repeated.runs} draws of poses and noise, seed {repeated.seed}."


def _own_words(repeated: Repeated) -> str:
    return SIMULATED_HERE if repeated.study.section == 5 else ""


SIMULATED_HERE = "Simulated here; published: measured on the real arm"
