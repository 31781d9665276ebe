"""What gravity does to a robot, in words, figures and for machines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from urdfcal.base.geometry import MM, Matrix
from urdfcal.base.minus import with_minus
from urdfcal.base.rotations import skew
from urdfcal.base.terminal import displayed, figures_table, rounded, titled, value_and_sigma
from urdfcal.calibration.analysis.sag import SagFit
from urdfcal.calibration.problem import Problem

if TYPE_CHECKING:
    from rich.console import RenderableType


_MRAD = 1e-3
_WORTH_IT = 3.0  # of log evidence, under which sag explains nothing
_MUCH_BETTER = 0.5  # of the held-out error, under which the pair is worth a word even where geometry alone is of no use
_WORTH_A_WORD = 0.8  # of the held-out error, under which whoever uses geometry alone has to know of it
_NO_GAIN = 0.99  # of the held-out error, above which it gains nothing


@dataclass(frozen=True)
class Deflection:
    """What one joint does under gravity, at the poses that were fitted.

    Attributes:
        joint: Its name.
        mrad: By how much it turns at most, all axes together.
        tool_mm: How far the largest moves the module, or the farthest target.
    """

    joint: str
    mrad: float
    tool_mm: float


def deflections(sag: SagFit) -> list[Deflection]:
    """Largest deflection of every joint over the fitted poses."""
    softness, data = sag.softness, sag.calibration.data
    basis = softness.basis(data.q, data.payload, data.approach)
    values = np.array([sag.soft_values[term.name][0] for term in softness.terms])
    twists = _twists_at_tool(sag)
    found = []
    for joint in dict.fromkeys(term.joint for term in softness.terms):
        own = [number for number, term in enumerate(softness.terms) if term.joint == joint]
        turning = [number for number in own if softness.terms[number].axis is not None or not softness.chain.moving[joint].joint.prismatic]
        angle = np.linalg.norm((basis * values)[:, turning], axis=1)
        moved = np.linalg.norm(twists[:, :3, own] @ values[own], axis=1)
        found.append(Deflection(softness.chain.moving[joint].joint.name, float(angle.max()) / _MRAD, float(moved.max()) / MM))
    return found


def _twists_at_tool(sag: SagFit) -> Matrix:
    """Motion of the module, or the farthest target, per unit of every soft parameter, at the fitted poses, (n, 6, terms)."""
    model, errors, x = Problem(sag.errors, sag.calibration.data), sag.errors, sag.estimate.belief.x
    motion = model.motion(x)
    columns = [errors.names.index(term.name) for term in sag.softness.terms]
    lasers = errors.chain.laser_frames
    point = motion.frames[lasers[0] if lasers else errors.chain.farthest][:, :, 3]
    twists = motion.jac1[:, :, columns]
    return np.concatenate([twists[:, :3] - skew(point) @ twists[:, 3:], twists[:, 3:]], axis=1)


def worth_it(sag: SagFit) -> bool:
    """Whether a compensation would be worth its trouble: the data ask for it, and poses that were not fitted gain by it."""
    return sag.gain > _WORTH_IT and (sag.held_out is None or sag.held_out.weighed < _NO_GAIN)


def sag_words(sag: SagFit) -> str:
    """What sag gains, in a line."""
    kind = "generic masses" if sag.softness.weighed.generic else "the URDF's masses"
    direction = ", ".join(f"{part:.3g}" for part in sag.gravity.direction)
    head = f"gravity along ({direction}) of '{sag.calibration.robot.tree.root}', {kind}"
    if sag.held_out is None:
        return f"{head}: {_gain(sag)}"
    left, what = sag.held_out, " and ".join(("sag", *sag.kept))
    trimmed = ", outliers left out" if any(outlier.kind != "exchanged" for outlier in sag.calibration.outliers) else ""
    return (
        f"{head}: held-out poses ({left.folds}-fold{trimmed}) {rounded(left.geometry, 3)} {left.unit} RMS with geometry alone, "
        f"{rounded(left.sag, 3)} {left.unit} with {what} ({_percent(left.ratio - 1)}); {_gain(sag)}"
    )


def _gain(sag: SagFit) -> str:
    """By how much the data prefer both together; what the residuals of geometry alone ask for (`stands_out`) is another number."""
    return f"fitted with the geometry it gains {round(sag.gain):+d} nats of log evidence"


def _percent(share: float) -> str:
    return f"{percent:+d} %" if (percent := round(100 * share)) else "no change"


def asked_for(sag: SagFit | None) -> tuple[str, ...]:
    """What the data ask for beside geometry, and poses that were not fitted are the better for."""
    left = sag.held_out if sag is not None else None
    if sag is None or left is None or not worth_it(sag) or left.weighed > _WORTH_A_WORD:
        return ()
    return ("sag", *sag.kept)


def in_compensation(sag: SagFit | None) -> tuple[str, ...]:
    """What a compensation has in it that is worth its trouble."""
    return () if sag is None or not worth_it(sag) else ("sag", *sag.kept)


def pair_words(sag: SagFit | None) -> tuple[str, ...]:
    """What geometry and compensation together would bring, where geometry alone is of no use."""
    left = sag.held_out if sag is not None else None
    if sag is None or left is None or not worth_it(sag) or left.ratio > _MUCH_BETTER:
        return ()
    found = ", ".join(" ".join(row) for row in extras_rows(sag))
    return (
        f"a compensation beside the geometry ({found or 'sag'}) brings held-out poses from {rounded(left.geometry, 3)} to "
        f"{rounded(left.sag, 3)} {left.unit}: --compensation FILE with --force writes that pair",
    )


def sag_blocks(sag: SagFit, written: str = "") -> list[RenderableType]:
    """For people.

    Args:
        sag: The joint fit.
        written: The compensation that was written, if one was.
    """
    blocks: list[RenderableType] = ["", f"Sag: {with_minus(sag_words(sag))}"]
    if sag.dropped:
        blocks.append(f"left out, since the data do not ask for it: {', '.join(sag.dropped)}")
    blocks += _extras_told(sag)
    if "approach" in sag.kept:
        blocks.append("what the approach explains can be made up for only where control code tells each joint's last move (approach=...)")
    if not worth_it(sag):
        blocks.append("  not worth a compensation" + (", which was written all the same" if written else ""))
        if not written:
            return blocks
    table = figures_table("joint")
    for name in ("largest deflection\nmrad", "moves the tool by\nmm"):
        table.add_column(name, justify="right")
    for each in deflections(sag):
        table.add_row(each.joint, f"{each.mrad:.3f}", f"{each.tool_mm:.3f}")
    said = f"written to {written}" if written else "not in the URDF, which is that of geometry alone; --compensation FILE.yaml writes it"
    blocks += ["", titled(f"Deflections at the fitted poses ({said})", table)]
    return [*blocks, "", sag.compensation().shortfall().words] if written else blocks


def extras_rows(sag: SagFit) -> list[tuple[str, str, str]]:
    """Name, value with its sigma, and unit, of what was found beside sag."""
    found = []
    for term in sag.softness.terms:
        if not term.largest:
            (value, sigma), (unit, size) = sag.soft_values[term.name], displayed(term.unit)
            found.append((term.name, value_and_sigma(value / size, sigma / size), unit))
    return found


def _extras_told(sag: SagFit) -> list[RenderableType]:
    rows = extras_rows(sag)
    table = figures_table("parameter")
    table.add_column("value ± sigma", justify="right")
    table.add_column("unit")
    for row in rows:
        table.add_row(*row)
    return ["", titled("Found beside sag", table), ""] if rows else []


def sag_json(sag: SagFit, written: bool = False) -> dict[str, Any]:
    """For machines; SI but for names that say otherwise.

    Args:
        sag: The joint fit.
        written: Whether its compensation is, so that it matters how far corrected joint positions fall short.
    """
    held, units = sag.held_out, {term.name: term.unit or "1" for term in sag.softness.terms}
    return {
        "gravity": list(sag.gravity.direction),
        "payloads_kg": dict(sag.gravity.payloads),
        "masses": "generic" if sag.softness.weighed.generic else "urdf",
        "log_evidence_gain": sag.gain,
        "held_out": None if held is None else {f"geometry_{held.unit}": held.geometry, f"sag_{held.unit}": held.sag, "folds": held.folds},
        "parameters": [
            {"name": name, "value": value, "sigma": sigma, "unit": units[name]} for name, (value, sigma) in sag.soft_values.items()
        ],
        "deflections": [{"joint": each.joint, "mrad": each.mrad, "tool_mm": each.tool_mm} for each in deflections(sag)],
        "joint_positions_fall_short_mm": sag.compensation().shortfall().in_mm() if written else None,
        "worth_it": worth_it(sag),
        "kept": list(sag.kept),
        "dropped": list(sag.dropped),
        "warnings": list(sag.warnings),
    }
