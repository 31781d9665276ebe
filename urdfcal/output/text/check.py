"""The result of `check` as text and for machines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from urdfcal.base.terminal import displayed, figures_table, many, rounded, titled
from urdfcal.calibration.analysis.check import Check
from urdfcal.estimation.identifiability import HiddenSum, in_words
from urdfcal.model.parameters import INSTRUMENTS
from urdfcal.output.text.dh import carried_lines
from urdfcal.output.text.instruments import assumed_noise, parameters_in_words

if TYPE_CHECKING:
    from rich.console import RenderableType


_MEANINGS = {
    "O1": "volume of what is seen (Borm and Menq)",
    "O2": "worst over best seen direction (Driels and Pathre)",
    "O3": "worst seen direction (Nahvi et al.)",
    "O4": "worst seen direction, and its share of the best (Nahvi and Hollerbach)",
    "O5": "harmonic mean of all (Sun and Hollerbach)",
}


def check_blocks(check: Check) -> list[RenderableType]:
    """Verdict, hidden and weak directions, expected sigmas, indices, gauge and what would help."""
    blocks: list[RenderableType] = [_verdict(check)]
    blocks += _section("Hidden in these measurements:", [_hidden(check, hidden) for hidden in _of_robot(check)])
    blocks += _section(
        "Seen, but not well enough to halve the prior:",
        [f"{words}: {times:.0f} times worse than the median direction" for words, times in check.observability.weak],
    )
    blocks += ["", _sigma_table(check), "", _index_table(check)]
    blocks += _section("Not in the state, since no measurement could tell them from others:", carried_lines(check.errors.carried))
    blocks += _section("What would help:", [_suggested(suggestion.words, suggestion.determines) for suggestion in check.suggestions])
    return blocks


def check_json(check: Check) -> dict[str, Any]:
    """The same for machines; SI."""
    rows = zip(check.errors.parameters, check.sigma, check.predicted.determined, strict=True)
    return {
        "parameters": [
            {
                "name": parameter.name,
                "unit": parameter.unit,
                "prior_sigma": parameter.sigma,
                "sigma": float(sigma),
                "determined": determined,
            }
            for parameter, sigma, determined in rows
        ],
        "rank": check.observability.rank,
        "determined": check.predicted.rank,
        "hidden": [{"terms": hidden.terms, "seen": hidden.seen, "words": _hidden(check, hidden)} for hidden in _of_robot(check)],
        "weak": [{"words": words, "times_worse": times} for words, times in check.observability.weak],
        "observability": check.observability.indices,
        "singular_values": check.observability.singular_values.tolist(),
        "carried": dict(check.errors.carried),
        "suggestions": [
            {"words": suggestion.words, "gain": suggestion.gain, "determines": list(suggestion.determines)}
            for suggestion in check.suggestions
        ],
        "warnings": list(check.warnings),
    }


def _verdict(check: Check) -> str:
    count, seen, decided = len(check.errors.names), check.observability.rank, check.predicted.rank
    what = "spots" if check.data.only_spots else "measurements"
    return (
        f"{check.robot.name}: {parameters_in_words(check.errors)}, {check.data.counted} with {check.data.summary}\n"
        f"the {what} move with {seen} of {many(count, 'direction')}; "
        f"with {assumed_noise(check.data, check.noise)} a fit would determine {decided}"
    )


def _of_robot(check: Check) -> list[HiddenSum]:
    """What is hidden of the robot's own errors; frames, targets and places are nobody's."""
    own = {parameter.name for parameter in check.errors.parameters if parameter.kind not in INSTRUMENTS}
    return [hidden for hidden in check.observability.hidden if not own.isdisjoint(hidden.terms)]


def _hidden(check: Check, hidden: HiddenSum) -> str:
    """`only joint1.d_d + joint2.d_d moves the spots`, or the measurements."""
    if check.data.only_spots:
        return hidden.words()
    words = in_words(hidden.terms)
    return f"only {words} moves the measurements" if hidden.seen else f"{words} moves no measurement"


def _sigma_table(check: Check) -> RenderableType:
    table = figures_table("parameter")
    for name in ("prior sigma", "sigma after a fit"):
        table.add_column(name, justify="right")
    table.add_column("unit")
    for parameter, sigma, determined in zip(check.errors.parameters, check.sigma, check.predicted.determined, strict=True):
        if parameter.kind in INSTRUMENTS:
            continue
        unit, size = displayed(parameter.unit)
        table.add_row(
            parameter.name, rounded(parameter.sigma / size, 3), rounded(sigma / size, 3) if determined else "not determined", unit
        )
    return titled("What a fit of these poses would claim", table)


def _index_table(check: Check) -> RenderableType:
    table = figures_table("index")
    table.add_column("value", justify="right")
    table.add_column("meaning, in units of the prior over the noise")
    for name, value in check.observability.indices.items():
        table.add_row(name, f"{rounded(value, 3)}", _MEANINGS[name])
    return titled("Observability", table)


def _suggested(words: str, determines: tuple[str, ...]) -> str:
    return f"{words}; it would determine {', '.join(determines)}" if determines else words


def _section(title: str, lines: list[str]) -> list[RenderableType]:
    return ["", title, *(f"  {line}" for line in lines)] if lines else []
