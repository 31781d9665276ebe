"""Fig. 4 in figures, and Table V: the errors that were estimated, beside those that are published."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from urdfcal.base.geometry import DEG, MM, Vector
from urdfcal.base.terminal import decimals, rounded
from urdfcal.calibration.result import FitResult
from urdfcal.estimation.identifiability import in_words
from urdfcal.output.paper.distances import SIMULATED_HERE
from urdfcal.output.paper.exhibit import DIFFERENCE, HERE, NONE, PUBLISHED, Exhibit, three_lines
from urdfcal.output.report.document import Table
from urdfcal.simulation.paper import Repeated
from urdfcal.simulation.published import FIG_4_NORM, FIG_4_SWEEPS, TABLE_V
from urdfcal.simulation.study import CASES

_KINDS = {"d_a": "Δa", "d_d": "Δd", "d_alpha": "Δα", "d_theta": "Δθ"}
_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
_UNITS = {"m": ("mm", MM), "rad": ("°", DEG)}


def figure_exhibits(repeated: Repeated) -> list[Exhibit]:
    """What is published of Fig. 4 in words, and where its curves end."""
    protocol = last_protocol(repeated)
    first, x = repeated.first[protocol], repeated.first[protocol].x
    joints = list(dict.fromkeys(name.rpartition(".")[0] for name, each in _parameters(repeated) if each == "joint"))
    rows: list[tuple[str, ...]] = []
    for number, joint in enumerate(joints, start=1):
        rows += three_lines(str(number), _of(repeated, repeated.truth, joint), _of(repeated, x, joint), 2)
    what = f"case 1, EKF, {protocol} a pose; the first draw of seed {repeated.seed}"
    return [
        Exhibit(
            "figure-4",
            "Fig. 4: how the estimates of case 1 came to rest",
            f"Here: {what}. The published curves are a picture; what the paper says of them in figures stands here.",
            _facts(repeated, first),
            picture="convergence",
        ),
        Exhibit(
            "figure-4-ends",
            "Fig. 4: where its curves end",
            f"Errors after the last sweep. Published: those that were put in, which the curves are said to reach. Here: {what}.",
            Table(
                ("joint", "", *(f"{sign} ({unit})" for sign, unit in zip(_KINDS.values(), ("mm", "mm", "°", "°"), strict=True))),
                tuple(rows),
                2,
            ),
            "Thirty poses near home leave some of the errors loose, whatever the filter's covariance says: with Q > 0 it does "
            "not measure accuracy.",
            lines=3,
        ),
    ]


def last_protocol(repeated: Repeated) -> str:
    """The protocol with most readings a pose."""
    return list(repeated.study.protocols)[-1]


def table_v(repeated: Repeated) -> Exhibit:
    """Estimated errors of the 4-DOF arm by case, and of the sums that are all that its spots can tell."""
    protocol = next(iter(repeated.study.protocols))
    here = {case: repeated.estimates[protocol, "EKF", case].mean(axis=0) for case in CASES}
    hidden = {name for found in repeated.hidden for name in found.terms}
    rows = []
    for column, name in enumerate(repeated.errors.names):
        unit, size = _UNITS[repeated.errors.units[column]]
        own = {case: None if name in hidden else float(here[case][column] / size) for case in CASES}
        rows.append(_row(f"{symbol(name)} ({unit}){' *' if name in hidden else ''}", own, column))
    sums = [_sum_row(repeated, here, found.terms) for found in repeated.hidden if found.seen]
    groups = (("", 1), *((f"case {case}", 3) for case in CASES))
    return Exhibit(
        "table-V",
        f"Table V: estimated errors of the 4-DOF arm, {protocol} a pose",
        f"Here: mean of the estimates over the draws ({repeated.runs}, seed {repeated.seed}). The true errors of the simulation are the "
        "published estimates of case 3.",
        Table(("parameter", *(PUBLISHED, HERE, DIFFERENCE) * len(CASES)), (*rows, *sums), 1, groups),
        f"{SIMULATED_HERE}. {_blind(repeated)}".strip(),
    )


def symbol(name: str) -> str:
    """A parameter as the paper writes it: `Δa₁`, `Trans(x, SLM)`."""
    owner, _, last = name.rpartition(".")
    number = re.sub(r"\D", "", owner).translate(_SUBSCRIPTS)
    if last in _KINDS:
        return f"{_KINDS[last]}{number}"
    motion, _, axis = last.partition("_")
    return f"{motion.capitalize()}({axis}, {owner.upper()})"


def _row(label: str, here: Mapping[int, float | None], column: int) -> tuple[str, ...]:
    return (label, *(cell for case, own in here.items() for cell in _cells(TABLE_V[case][column], own)))


def _cells(published: float, own: float | None) -> tuple[str, str, str]:
    """Published, here, and the difference; what is not determined here is not printed as if it were."""
    return (decimals(published, 4), NONE, NONE) if own is None else (decimals(published, 4), decimals(own, 4), decimals(own - published, 4))


def _sum_row(repeated: Repeated, here: Mapping[int, Vector], terms: Mapping[str, float]) -> tuple[str, ...]:
    """What a sum of parameters is, for published and own estimates."""
    names, units = repeated.errors.names, {repeated.errors.units[repeated.errors.names.index(name)] for name in terms}
    if len(units) > 1:
        return (in_words(terms), *(NONE,) * (3 * len(CASES)))
    unit, size = _UNITS[units.pop()]
    weights = np.array([terms.get(name, 0.0) for name in names])
    cells: list[str] = []
    for case in CASES:
        theirs, own = float(weights @ TABLE_V[case]), float(weights @ here[case]) / size
        cells += _cells(theirs, own)
    return (f"{in_words({symbol(name): weight for name, weight in terms.items()})} ({unit})", *cells)


def _blind(repeated: Repeated) -> str:
    told = [in_words({symbol(name): weight for name, weight in found.terms.items()}) for found in repeated.hidden if found.seen]
    if not told:
        return ""
    return (
        f"* Not determined: no spot of the nominal arm moves with one of these alone, only with {' and with '.join(told)}. What a filter "
        "says of them singly is where it happened to come to rest, so nothing stands here; their sums close the table."
    )


def _facts(repeated: Repeated, first: FitResult) -> Table:
    """What the paper says of Fig. 4 in figures, and the same of ours."""
    history = first.estimate.history
    at = min(FIG_4_SWEEPS, len(history) - 1)
    mm, deg = _largest(repeated, first.x)
    stop = f"{len(history) - 1}, {'under' if first.estimate.converged else 'not under'} the tolerance"
    rows = (
        ("errors put in, on every joint", "10 mm, 10 mm, 1°, 1°", _put_in(repeated)),
        (
            f"norm of the change of {len(first.x)} parameters by sweep {FIG_4_SWEEPS}",
            f"< {FIG_4_NORM:g}",
            f"{rounded(history[at].step, 2)} (m, rad)",
        ),
        ("sweeps", f"≤ {repeated.study.max_sweeps}", stop),
        ("largest error that is left at the end", NONE, f"{mm:.2f} mm, {deg:.2f}°"),
    )
    return Table(("what", PUBLISHED, HERE), rows, words=3)


def _put_in(repeated: Repeated) -> str:
    joint = next(name.rpartition(".")[0] for name, kind in _parameters(repeated) if kind == "joint")
    a, d, alpha, theta = _of(repeated, repeated.truth, joint)
    return f"{a:g} mm, {d:g} mm, {alpha:g}°, {theta:g}°"


def _largest(repeated: Repeated, x: Vector) -> tuple[float, float]:
    """The largest errors of lengths, [mm], and of angles, [deg], of the joints."""
    apart = np.abs(x - repeated.truth)
    joint = np.array([kind == "joint" for _, kind in _parameters(repeated)])
    length = np.array([unit == "m" for unit in repeated.errors.units])
    return float(apart[joint & length].max() / MM), float(apart[joint & ~length].max() / DEG)


def _parameters(repeated: Repeated) -> list[tuple[str, str]]:
    return [(parameter.name, parameter.kind) for parameter in repeated.errors.parameters]


def _of(repeated: Repeated, x: Vector, joint: str) -> list[float]:
    """A joint's four errors, [mm] and [deg]."""
    names = repeated.errors.names
    columns = [names.index(f"{joint}.{kind}") for kind in _KINDS]
    return [float(x[column] / _UNITS[repeated.errors.units[column]][1]) for column in columns]
