"""The measurement function of a robot: J = Jac2 Jac1, equation (12), stacked over all poses, for lasers and every other sensor."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from urdfcal.error_model import ErrorModel, Placements
from urdfcal.frame_jacobian import CHUNK, ArmKinematics, LaserMotion, motion_at
from urdfcal.geometry import Array3, Matrix, Vector
from urdfcal.measurements import Mask, Measurements
from urdfcal.noise import Block, Linearisation, Noise
from urdfcal.pixel_spots import PixelSpots
from urdfcal.reading_kinds import start_sigma_of
from urdfcal.sensors import spot_jacobian, spots_on_screen
from urdfcal.target_model import Reading, known_rows, readings_of

Rows = slice | npt.NDArray[np.intp]


class SpotModel:
    """Predicts the spots of a set of poses and their derivative by the error parameters."""

    def __init__(self, errors: ErrorModel, data: Measurements, joints: bool = False) -> None:
        """Prepare for some poses; `joints` also differentiates by the measured joints, for their noise."""
        self.errors, self.data, self.joints = errors, data, joints
        self.arm = ArmKinematics(errors.chain, errors.soft.bends if errors.soft is not None else ())
        self.positions = self.arm.chain_positions(data.q)
        self.soft_basis = errors.soft.basis(data.q, data.payload, data.approach) if errors.soft is not None else None
        targets = readings_of(errors, data, first=2 * len(data.lasers))
        self.readings: tuple[Reading | PixelSpots, ...] = (*targets, *self._pixel_spots(errors, data, targets))
        self.spots = slice(0, 2 * len(data.lasers))
        self.kinds = kinds_of(data)
        self.blocks = self._blocks()
        self.measured = np.concatenate([np.repeat(data.seen, 2, axis=1), *(each.measured for each in self.readings)], axis=1)
        stated = [np.broadcast_to(each.data.sigma[:, None], each.measured.shape) for each in self.readings]
        self.stated_sigma = np.concatenate([np.repeat(data.sigma, 2, axis=1), *stated], axis=1)
        self.parts = [part for session in errors.sessions for part in self._chunks(session)]
        self.blind = _other_lasers_rows(errors)

    def predict(self, x: Vector) -> tuple[Array3, Matrix]:
        """Spots (n, lasers, 2) and beam lengths (n, lasers) at x, [m]."""
        n, lasers = self.data.seen.shape
        spots, lengths = np.empty((n, lasers, 2)), np.empty((n, lasers))
        placed = {session: self.errors.placements(x, session).still() for session in self.errors.sessions}
        for session, rows in self.parts:
            motion = self.motion(x, placed[session], rows)
            spots[rows], lengths[rows] = spots_on_screen(motion.source, motion.direction)
        return spots, lengths

    def linearise(self, x: Vector) -> Linearisation:
        """Residual and Jacobian of every measured spot coordinate at x."""
        n, numbers = self.measured.shape
        residual, jacobian = np.empty((n, numbers)), np.empty((n, numbers, len(self.errors.names)))
        joint_jacobian = np.empty((n, numbers, len(self.data.joints) if self.joints else 0))
        reached, own = True, self.spots
        placed = {session: self.errors.placements(x, session) for session in self.errors.sessions}
        for session, rows in self.parts:
            motion = self.motion(x, placed[session], rows, self.joints)
            spots, lengths = spots_on_screen(motion.source, motion.direction)
            seen, measured = self.data.seen[rows], self.measured[rows, own]
            reached &= bool((lengths[seen] > 0).all() and np.isfinite(lengths[seen]).all())
            residual[rows, own] = np.where(measured, (self.data.spots[rows] - spots).reshape(len(spots), -1), 0.0)
            jacobian[rows, own], joint_jacobian[rows, own] = self._derivatives(motion, spots, measured)
            for each in self.readings:
                if isinstance(each, PixelSpots):
                    own_lengths = lengths[each.data.seen[rows], each.laser]
                    reached &= bool((own_lengths > 0).all() and np.isfinite(own_lengths).all())
                looked = each.look(motion, placed[session], rows, x)
                residual[rows, each.columns], jacobian[rows, each.columns], joint_jacobian[rows, each.columns] = looked
        trouble = "left_screen" if not reached else "" if np.isfinite(residual).all() else "not_finite"
        here = Linearisation(residual, jacobian, joint_jacobian, self.measured, self.stated_sigma, trouble, self.blocks)
        return known_rows(here, self.errors, self.data.lengths, x)

    @staticmethod
    def _pixel_spots(errors: ErrorModel, data: Measurements, targets: tuple[Reading, ...]) -> Iterator[PixelSpots]:
        """Spots that were read as pixels, with their numbers behind all others."""
        first = max([2 * len(data.lasers), *(each.columns.stop for each in targets)])
        for own in (each for each in data.readings if data.of_laser(each)):
            yield PixelSpots(own, data.lasers.index(own.link), data.camera, errors, first)
            first += 2

    def _blocks(self) -> tuple[Block, ...]:
        """Every spot and every reading of a pose, with the index of its noise."""
        spots = tuple(Block(laser, slice(2 * index, 2 * index + 2)) for index, laser in enumerate(self.data.lasers))
        return (*spots, *(each.block(self.kinds.index(each.data.kind)) for each in self.readings))

    def motion(self, x: Vector, placed: Placements, rows: Rows, joints: bool = False) -> LaserMotion:
        """Where everything is at some poses, and how it moves; joints give way as far as the error model has them."""
        yielding = self.errors.yielding(x, self.soft_basis[rows]) if self.soft_basis is not None else None
        return motion_at(self.arm, placed, self.positions[rows], joints, yielding)

    def unreached(self, x: Vector) -> tuple[int, int] | None:
        """Pose and laser of the first measured beam that does not meet the screen at x."""
        lengths = self.predict(x)[1]
        missing = np.argwhere(self.data.seen & ~((lengths > 0) & np.isfinite(lengths)))
        return (int(missing[0, 0]), int(missing[0, 1])) if len(missing) else None

    def _derivatives(self, motion: LaserMotion, spots: Array3, measured: Mask) -> tuple[Array3, Array3]:
        n, numbers = measured.shape
        if not numbers:
            return np.empty((n, 0, motion.jac1.shape[2])), np.empty((n, 0, motion.joint_jacobian.shape[2]))
        jac2 = spot_jacobian(spots, motion.direction).reshape(n, numbers, 6)
        if not measured.all():
            jac2[~measured] = 0.0
        jacobian = jac2 @ motion.jac1
        if self.blind is not None:
            jacobian[:, self.blind] = 0.0
        return jacobian, jac2 @ motion.joint_jacobian

    def _chunks(self, session: str) -> list[tuple[str, Rows]]:
        if len(self.errors.sessions) == 1:
            return [(session, slice(start, start + CHUNK)) for start in range(0, len(self.data), CHUNK)]
        rows = np.flatnonzero(self.data.sessions == session)
        return [(session, rows[start : start + CHUNK]) for start in range(0, len(rows), CHUNK)]


def model_for(errors: ErrorModel, data: Measurements, noise: Noise) -> SpotModel:
    """The model of some poses with what noise asks for: derivatives by the joints, too, where their readings are noisy."""
    return SpotModel(errors, data, joints=noise.of_joints)


def kinds_of(data: Measurements) -> tuple[str, ...]:
    """What was measured, in the order of the noise: spots first, then the readings' kinds as they come."""
    spots = ("spot",) if data.lasers else ()
    return (*spots, *dict.fromkeys(each.kind for each in data.readings))


def start_sigma(data: Measurements) -> Vector:
    """Noise of every kind before any is known, (kinds,)."""
    return np.array([start_sigma_of(kind) for kind in kinds_of(data)])


def _other_lasers_rows(errors: ErrorModel) -> Mask | None:
    """Mask (numbers, p) of the derivatives that are zero because a beam's own parameters move that beam alone."""
    moves = np.repeat(errors.moves_laser, 2, axis=0)
    mask: Mask = ~moves
    return None if moves.all() else mask
