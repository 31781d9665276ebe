"""The result of `check` as text and for machines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from urdfcal.check import Check
from urdfcal.geometry import MM
from urdfcal.report import carried_lines, displayed, figures_table, titled

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
    blocks += _section("Hidden in these measurements:", [hidden.words() for hidden in check.observability.hidden])
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
        "hidden": [{"terms": hidden.terms, "seen": hidden.seen, "words": hidden.words()} for hidden in check.observability.hidden],
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
    poses, spots = len(check.data), int(check.data.seen.sum())
    return (
        f"{check.robot.name}: {count} parameters, {poses} poses with {spots} spots\n"
        f"the spots move with {seen} of {count} directions; "
        f"with {check.noise.spot_sigma / MM:.3g} mm of spot noise a fit would determine {decided}"
    )


def _sigma_table(check: Check) -> RenderableType:
    table = figures_table("parameter")
    for name in ("prior sigma", "sigma after a fit"):
        table.add_column(name, justify="right")
    table.add_column("unit")
    for parameter, sigma, determined in zip(check.errors.parameters, check.sigma, check.predicted.determined, strict=True):
        unit, size = displayed(parameter.unit)
        table.add_row(parameter.name, f"{parameter.sigma / size:.3g}", f"{sigma / size:.3g}" if determined else "not determined", unit)
    return titled("What a fit of these poses would claim", table)


def _index_table(check: Check) -> RenderableType:
    table = figures_table("index")
    table.add_column("value", justify="right")
    table.add_column("meaning, in units of the prior over the noise")
    for name, value in check.observability.indices.items():
        table.add_row(name, f"{value:.3g}", _MEANINGS[name])
    return titled("Observability", table)


def _suggested(words: str, determines: tuple[str, ...]) -> str:
    return f"{words}; it would determine {', '.join(determines)}" if determines else words


def _section(title: str, lines: list[str]) -> list[RenderableType]:
    return ["", title, *(f"  {line}" for line in lines)] if lines else []
