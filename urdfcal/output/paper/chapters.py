"""Sections IV and V of the paper, each with its tables."""

from __future__ import annotations

from urdfcal.output.paper.distances import SIMULATED_HERE, after_exhibits, before_exhibit, stated_exhibit
from urdfcal.output.paper.estimates import figure_exhibits, table_v
from urdfcal.output.paper.exhibit import Chapter, draws
from urdfcal.output.paper.nominal import nominal_exhibit
from urdfcal.simulation.paper import Repeated

_TITLES = {4: "Section IV: the simulation", 5: "Section V: the experiment, simulated"}


def chapter_of(repeated: Repeated) -> Chapter:
    """What the paper has of a section, published beside repeated."""
    nominal, before = nominal_exhibit(repeated.robot, repeated.study.section), before_exhibit(repeated)
    if repeated.study.section == 4:
        exhibits = (nominal, before, *after_exhibits(repeated), stated_exhibit(repeated), *figure_exhibits(repeated))
    else:
        exhibits = (nominal, table_v(repeated), before, *after_exhibits(repeated))
    return Chapter(f"section-{repeated.study.section}", _TITLES[repeated.study.section], tuple(_opening(repeated)), exhibits)


def _opening(repeated: Repeated) -> list[str]:
    study = repeated.study
    protocols = " and ".join(f"the {name}" if name.startswith("mean") else name for name in study.protocols)
    common = (
        f"Simulated: {draws(repeated.runs)} of {2 * study.half} poses and their noise, seed {repeated.seed}. "
        f"{study.half} poses lie within 10° of home, {study.half} over the whole ranges. "
        f"Joints are read to ±0.1° and spots to ±2 mm, uniform; each pose has {protocols}. "
        "Case 1 calibrates near home and is tested over the ranges, case 2 takes half of each, case 3 all."
    )
    if study.section == 4:
        return [
            common,
            "How often a pose was read is not published. One reading leaves about a millimetre, whatever the estimator; the published "
            "tenths appear with about 100. Poses and noise of the authors are not published either, so no figure can be equal.",
        ]
    return [
        f"{SIMULATED_HERE}.",
        common,
        "The true errors are those that the paper estimated from all its poses (Table V, case 3). The noise is what the paper says of its "
        "joints and spots; how many readings it averaged, it does not say: its figures lie between one reading a pose and the mean of two. "
        "A real arm also has errors that no table of four numbers a joint can hold; here there are none.",
    ]
