"""Harmonics of gears: waves over a joint's angle, looked for at every whole number of cycles a turn.

Which one is the best is found in single precision; what it gains is worked out in double.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from urdfcal.base.geometry import Array3, Mask, Matrix, Vector
from urdfcal.calibration.asking.questions import Answer
from urdfcal.calibration.asking.strip import Strip
from urdfcal.estimation.score import ComplexMatrix, Fitted, Pairs
from urdfcal.model.softness import GEAR

MOST = 200  # cycles a turn of the joint
CYCLES = np.arange(1, MOST + 1)
GEARS = CYCLES > 2  # one and two are eccentricity


def gears(joints: Sequence[str], angles: Matrix, fitted: Fitted, some: Strip, asked: Sequence[Mask]) -> Iterator[Answer]:
    """The best harmonic of any joint's gear of each of some CYCLES.

    Args:
        joints: Names of the turning joints that were read.
        angles: Their positions in some rows, (joints, n).
        fitted: A fit of these rows.
        some: The rows.
        asked: Each of CYCLES that are asked about, (cycles,); where there are none there is no answer.
    """
    wanted = [cycles for cycles in asked if cycles.any()] if len(joints) else []
    if not wanted:
        return
    left = fitted.left(some.columns)
    gains = _gains(fitted, left, GEAR * some.turns, angles)
    for cycles in wanted:
        joint, found = np.unravel_index(np.argmax(np.where(cycles, gains, -np.inf)), gains.shape)
        gear = int(joint), int(CYCLES[found])
        score = fitted.asked_of(left, columns_of(gear[1], angles[joint], some.turns[joint]))
        gain = score.gain - float(np.log(np.count_nonzero(cycles) * len(joints)))
        yield Answer("harmonics", joints[gear[0]], gain, gear=gear, size=score.size, share=score.explained)


def columns_of(cycles: int, q: Vector, turn: Matrix) -> Array3:
    """Both waves of a gear, in units of their usual size, (2, m, n), of a joint at q, (n,), by which numbers go by `turn`, (m, n)."""
    return np.asarray(turn * (GEAR * np.stack([np.sin(cycles * q), np.cos(cycles * q)]))[:, None])


def _gains(fitted: Fitted, left: Array3, turns: Array3, angles: Matrix) -> Matrix:
    """What each of CYCLES of each joint gains, (joints, cycles), in single precision."""
    waves = np.empty((angles.shape[1], MOST), dtype=np.complex64)
    single, columns = left.astype(np.float32), turns.astype(np.float32)
    pairs = [fitted.asked_in_waves(single, column, _fill(waves, q)) for column, q in zip(columns, angles, strict=True)]
    every = Pairs(np.concatenate([own.s for own in pairs]), np.concatenate([own.F for own in pairs]), fitted.total, fitted.numbers)
    return every.gains.reshape(len(turns), MOST)


def _fill(waves: ComplexMatrix, q: Vector) -> ComplexMatrix:
    """exp(i k q) for all CYCLES into (n, cycles): as many again from those that there are, times the last of them."""
    waves[:, 0], known = np.exp(1j * q), 1
    while known < MOST:
        more = min(known, MOST - known)
        np.multiply(waves[:, :more], waves[:, known - 1 : known], out=waves[:, known : known + more])
        known += more
    return waves
