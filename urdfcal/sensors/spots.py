"""Laser spots on a screen: equations (7), (8) and (11), in metres on the screen or as the pixels of a camera that looks at it.

A laser leaves its source p along z and meets the screen x = 0 at distance k = -p_x / z_x (8); the spot is the (y, z) of p + k z (7).
In a picture the spot s = (0, y, z) of the screen frame is seen at

    u = project(T_camera_screen E_1 ... E_6 s)

where `project` is the calibrated lens, T_camera_screen the calibrated place of the screen in front of the camera and E_k the
exponentials of its six errors `camera.trans_x ... camera.rot_z` in screen axes. These are parameters with the calibration's own
covariance for a prior, so that a slightly wrong screen calibration does not become a joint error.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, Literal

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import SE3, Array3, Array4, Mask, Matrix, Vector, six_screws
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.jacobian import ArmMotion, arm_motion
from urdfcal.robot.chain import Chain
from urdfcal.robot.rig import SIX, Place
from urdfcal.sensors.pixels import PixelSensor, out_of_picture
from urdfcal.sensors.sensor import (
    Change,
    Disturbance,
    Look,
    Quantity,
    Sensor,
    Sight,
    View,
    Words,
    bent_by_a_lens,
    require_pair,
    wrong_lengths,
    wrong_scale,
)

_ON_SCREEN = {
    "y and z of the spots swapped": [[0, 1], [1, 0]],
    "y of the spots mirrored, as if seen from behind the screen": [[-1, 0], [0, 1]],
    "z of the spots mirrored": [[1, 0], [0, -1]],
    "y and z of the spots both mirrored, as by a camera upside down": [[-1, 0], [0, -1]],
    "the spots turned by 90 deg": [[0, -1], [1, 0]],
    "the spots turned by -90 deg": [[0, 1], [-1, 0]],
    "y and z of the spots swapped and mirrored": [[0, -1], [-1, 0]],
}
LEAST_LENGTH = 0.1  # [m] of beams that are simulated: nearer to the screen the nominal robot's module may already stand behind it
LEAST_ZX = 0.3  # beams that graze the screen more flatly than this make no spot
_ALONG, _QUARTER = np.eye(2), np.array([1.0, -1.0])  # v_y and v_z as they are; (z, -y) is (z, y) times this


def spots_on_screen(source: Array3, direction: Array3) -> tuple[Array3, Matrix]:
    """Where beams meet the screen: equations (7) and (8).

    Args:
        source: (..., 3) in screen axes, [m].
        direction: (..., 3) unit vectors in screen axes.

    Returns:
        Spots (y, z), (..., 2), [m]; and beam lengths k, (...), [m], negative where the screen lies behind the laser
        and infinite or nan where the beam is parallel to it.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        length = -source[..., 0] / direction[..., 0]
        return source[..., 1:] + length[..., None] * direction[..., 1:], length


def makes_spot(length: Matrix, direction: Array3, nearest: float = 0.0, farthest: float = np.inf) -> Mask:
    """Which beams make a spot that can be measured: they meet the screen, at no grazing angle, within a range of lengths.

    Args:
        length: Beam lengths k, (n, lasers), [m].
        direction: (n, lasers, 3) unit vectors in screen axes.
        nearest: Least length, [m].
        farthest: Greatest length, [m].

    Returns:
        (n, lasers).
    """
    with np.errstate(invalid="ignore"):
        return (length > nearest) & (length < farthest) & (np.abs(direction[..., 0]) > LEAST_ZX)


def spot_jacobian(spots: Array3, direction: Array3) -> Array4:
    """Jac2: motion of the spots per twist [v, w] of their lasers' carrier, in screen axes, taken at the screen's origin.

    The point of the beam that stands on the spot s moves with v + w x s; its motion along x is given back along the beam, so
    dy = v_y - (z_y / z_x) v_x and dz = v_z - (z_z / z_x) v_x of that point. Written for the twist at the source p, with
    s - p = k z, these are the two rows of equation (11).

    Args:
        spots: (..., 2), [m].
        direction: (..., 3).

    Returns:
        (..., 2, 6); rows are y and z of the spot.
    """
    jac2, turned = np.zeros((*spots.shape, 6)), spots[..., ::-1] * _QUARTER
    with np.errstate(divide="ignore", invalid="ignore"):
        lean = direction[..., 1:] / -direction[..., :1]
        jac2[..., 0], jac2[..., 1:3], jac2[..., 3] = lean, _ALONG, -turned
        jac2[..., 4:] = lean[..., None] * turned[..., None, :]
    return jac2


@dataclass(frozen=True)
class Beams:
    """Where beams are at some poses: of all of a robot's lasers, (n, lasers), or of one, (n,).

    Attributes:
        source: Where they leave, (..., 3) in screen axes, [m].
        direction: (..., 3) unit vectors in screen axes.
        spots: Where they meet the plane of the screen, (..., 2) = (y, z), [m].
        length: How far that is, (...), [m]; negative behind the laser, infinite or nan where beam and screen are parallel.
    """

    source: Array3
    direction: Array3
    spots: Array3
    length: Matrix

    @property
    def meets(self) -> Mask:
        """Which of them meet the screen at all, (...)."""
        with np.errstate(invalid="ignore"):
            return np.asarray((self.length > 0) & (self.length < np.inf))

    @property
    def meets_plainly(self) -> Mask:
        """Which of them meet the screen at no grazing angle, so that it can be seen where, (...)."""
        with np.errstate(invalid="ignore"):
            return np.asarray(self.meets & (np.abs(self.direction[..., 0]) > LEAST_ZX / 10))

    def makes_spot(self, nearest: float = 0.0, farthest: float = np.inf) -> Mask:
        """Which of them make a spot that can be measured, within a range of lengths [m], (...): see `makes_spot`."""
        return makes_spot(self.length, self.direction, nearest, farthest)


def beams_of(source: Array3, direction: Array3) -> Beams:
    """Beams from their sources along their directions, both (..., 3) in screen axes."""
    spots, length = spots_on_screen(source, direction)
    return Beams(source, direction, spots, length)


def beams_in(chain: Chain, motion: ArmMotion) -> Beams:
    """The beams of all lasers of a chain that stands on the screen."""
    lasers = motion.frames[chain.laser_frames]
    return beams_of(lasers[..., 3].transpose(1, 0, 2), lasers[..., 2].transpose(1, 0, 2))


def beams_at(errors: ErrorModel, x: Vector, q: Matrix, session: str | None = None) -> Beams:
    """The beams of a robot with errors x at measured joint positions q (n, inputs), in the first session unless another is named."""
    return beams_in(errors.chain, arm_motion(errors, q, x, errors.sessions[0] if session is None else session))


def _beams_seen(view: View) -> tuple[Matrix, Mask, Matrix]:
    """Spots (n, 2) of the beams of one laser, [m], which of them there are not, (n,), and the beams' directions, (n, 3)."""
    beams = beams_of(view.p, view.R[:, :, 2])
    return beams.spots, ~beams.meets, beams.direction


def _on_screen(spots: Matrix) -> Matrix:
    """Spots (n, 2) as points of the screen's axes, (n, 3)."""
    return np.concatenate([np.zeros((len(spots), 1)), spots], axis=1)


def _predicted_spots(view: View) -> Matrix:
    """Where the beams of one laser plainly meet the screen, (n, 3) in its axes, [m]; nan where they do not."""
    beams = beams_of(view.p, view.R[:, :, 2])
    return np.where(beams.meets_plainly[:, None], _on_screen(beams.spots), np.nan)


_BOW, _LENS = 4e-3, (8e-3, 4e-3)  # [1/m], [1/m^2]: a millimetre half a metre from the midst


class SpotSensor(Sensor):
    """A laser's spot in metres on the screen, h = (y, z)."""

    name = noise = "spot"
    words = Words("spot", "spots", "spot noise", "mm", 1.0, float("inf"), "a spot coordinate")  # the screen may be far away
    stored = numbers = 2
    components = "yz"
    drawn = "measured spots"
    seen_from: ClassVar[Literal["screen", "frame", "places"]] = "screen"
    beam = on_screen = True
    others = "the other spots"
    endings: ClassVar[Mapping[str, Quantity]] = {"y": "length", "z": "length"}
    empty = "leave both cells of a beam empty if it was not seen"
    mark = "spot, measured"

    def look(self, view: View, values: Matrix) -> Look:
        """See the base class."""
        spots, lost, direction = _beams_seen(view)
        return Look(values - spots, spot_jacobian(spots, direction), lost=lost)

    def read(self, view: View) -> Matrix:
        """See the base class; also of beams that leave the screen behind them."""
        return _beams_seen(view)[0]

    def predicted(self, view: View) -> Matrix:
        """See the base class; the spot."""
        return _predicted_spots(view)

    def shown(self, view: View, values: Matrix) -> Matrix:
        """See the base class; on the screen."""
        return _on_screen(values)

    def lacking(self, target: str, given: Collection[str]) -> tuple[str, str] | None:
        """See the base class."""
        missing = [ending for ending in self.endings if ending not in given]
        return (missing[0], f"is missing; a spot of {target} needs {target}.y and {target}.z") if missing else None

    def kept(self, columns: Mapping[str, Vector]) -> Matrix:
        """See the base class."""
        require_pair(columns, f"and the beam's other one is not; {self.empty}")
        return super().kept(columns)

    def mistakes(self) -> Mapping[str, Change]:
        """See the base class; on the screen itself, since its link has its own y and z."""
        turned = {words: partial(_turned, np.array(matrix, dtype=float)) for words, matrix in _ON_SCREEN.items()}
        return {**turned, **wrong_lengths("spots")}

    def drawn_at(self, view: View, values: Matrix) -> Matrix:
        """See the base class."""
        return values

    def unseen(self, view: View, sight: Sight) -> Mapping[str, Mask]:
        """See the base class: a beam must meet the screen that is there, from near its front, and not too flatly."""
        return _no_spot(view, sight)

    def sight_lines(self, view: View) -> tuple[Matrix, Matrix]:
        """The beam, from its spot to the laser."""
        return _on_screen(_beams_seen(view)[0]), view.p

    def taken_for_each_other(self, view: View) -> Matrix:
        """The spots."""
        return _on_screen(_beams_seen(view)[0])

    def disturbances(self, view: View) -> tuple[Disturbance, ...]:
        """See the base class: a screen that is bowed, what saw the spots on it, and its scale."""
        spots = _beams_seen(view)[0]
        return (_bow(view, spots), bent_by_a_lens(spots, _LENS, "1/m^2"), wrong_scale(spots))


class AimedSpotSensor(SpotSensor):
    """A laser's spot on the screen that it names, h = (y, z) there: lasers of several arms, on any screens, each a pair of its own."""

    name = "aimed_spot"
    beam = on_screen = False
    aimed = True
    seen_from = "frame"
    offset = ("trans_x", "trans_y", "rot_x", "rot_y")  # a beam may be shifted along itself, and turned about itself
    simulated = ("laser",)
    line = "beam"

    def read(self, view: View) -> Matrix:
        """See the base class; nan where the beam makes no spot."""
        beams = beams_of(view.p[:, None], view.R[:, None, :, 2])
        return np.where(beams.makes_spot(nearest=LEAST_LENGTH), beams.spots[:, 0], np.nan)

    def looks_from(self, view: View) -> Matrix:
        """The laser."""
        return view.p


def _no_spot(view: View, sight: Sight) -> Mapping[str, Mask]:
    """Why beams of one laser make no spot that can be measured."""
    beams = beams_of(view.p[:, None], view.R[:, None, :, 2])
    with np.errstate(invalid="ignore"):
        beside = ~(beams.makes_spot(LEAST_LENGTH)[:, 0] & sight.area.holds(beams.spots[:, 0]))
        flat = np.abs(beams.direction[:, 0, 0]) < np.cos(sight.steepest)
    return {"put a beam beside the screen": beside, f"have a beam over {np.degrees(sight.steepest):.0f} deg off the screen's normal": flat}


def _bow(view: View, spots: Matrix) -> Disturbance:
    """A screen at x = b_yy y^2 + b_yz y z + b_zz z^2: a beam along d meets it farther along by x / d_x.

    How the slopes change with d is left out: some hundredths of what a bow does.
    """
    y, z = spots.T
    with np.errstate(divide="ignore", invalid="ignore"):
        lean = view.R[:, 1:, 2] / view.R[:, :1, 2]
    depth, none = np.stack([y**2, y * z, z**2], axis=1), np.zeros_like(y)
    steep = np.array([[2 * y, none], [z, y], [none, 2 * z]]).transpose(2, 0, 1)
    slopes = lean[:, None, :, None] * steep[:, :, None]
    return Disturbance("screen_bow", ("bow_yy", "bow_yz", "bow_zz"), "1/m", (_BOW,) * 3, lean[:, :, None] * depth[:, None], slopes)


def _turned(matrix: Matrix, spots: Matrix) -> Matrix:
    return spots @ matrix.T


class SpotPixelSensor(PixelSensor):
    """A laser's spot as a camera that looks at the screen has it, h = u; the screen's place before the camera is shared by all poses."""

    name = "spot_pixel"
    simulated = ()
    seen_from = "screen"
    beam = True
    mark = "spot, measured"
    line = ""

    def look(self, view: View, values: Matrix) -> Look:
        """See the base class."""
        spots, lost, direction = _beams_seen(view)
        spots = np.where(np.isfinite(spots), spots, 0.0)
        T_camera_screen, twists = screen_before(self.camera.screen, view.place[0] if len(view.place) else np.zeros(6))
        points = _in_camera(T_camera_screen, spots)
        by_point = self.camera.project_jacobian(points)
        jac2 = by_point @ T_camera_screen.rotation[:, 1:] @ spot_jacobian(spots, direction)
        v, w = twists[:3], twists[3:]
        moved = v.T[None] + np.cross(w.T[None], points[:, None])  # (n, 6, 3) in camera axes
        return Look(values - self.camera.project(points), jac2, by_point @ moved.transpose(0, 2, 1), lost)

    def read(self, view: View) -> Matrix:
        """See the base class."""
        T_camera_screen, _ = screen_before(self.camera.screen, view.place[0] if len(view.place) else np.zeros(6))
        pixels: Matrix = self.camera.project(_in_camera(T_camera_screen, _beams_seen(view)[0]))
        return pixels

    def mistakes(self) -> Mapping[str, Change]:
        """See the base class; they are looked for on the screen, where the camera has the spots."""
        return {}

    def predicted(self, view: View) -> Matrix:
        """See the base class; the spot."""
        return _predicted_spots(view)

    def shown(self, view: View, values: Matrix) -> Matrix:
        """See the base class; where the rays of the pixels meet the screen."""
        T_camera_screen, _ = screen_before(self.camera.screen, view.place[0] if len(view.place) else np.zeros(6))
        return _on_screen(replace(self.camera, T_camera_screen=T_camera_screen).spots_of_pixels(np.nan_to_num(values)))

    def rays(self, values: Matrix) -> None:
        """None: the camera stands before the screen, not in the frame that the spots are in."""

    def looks_from(self, view: View) -> None:
        """None: the camera stands before the screen, not in the frame that the spots are in."""

    def unseen(self, view: View, sight: Sight) -> Mapping[str, Mask]:
        """See the base class: there must be a spot, and the camera must have it in its picture."""
        return {**_no_spot(view, sight), "are out of the picture": out_of_picture(self.camera, self.read(view))}

    def sight_lines(self, view: View) -> tuple[Matrix, Matrix]:
        """The beam, from its spot to the laser."""
        return _on_screen(_beams_seen(view)[0]), view.p

    def taken_for_each_other(self, view: View) -> Matrix:
        """The spots."""
        return _on_screen(_beams_seen(view)[0])

    def places(self, target: str, labels: Sequence[str]) -> tuple[Place, ...]:
        """The errors of the screen's place before the camera, of all lasers alike."""
        return (Place("camera", SIX, ("m",) * 3 + ("rad",) * 3, "camera"),)


def _in_camera(T_camera_screen: SE3, spots: Matrix) -> Matrix:
    """Spots (n, 2) on the screen as points in camera axes, (n, 3)."""
    return np.asarray(_on_screen(spots) @ T_camera_screen.rotation.T + T_camera_screen.translation)


def screen_before(T_camera_screen: SE3, errors: Vector) -> tuple[SE3, Matrix]:
    """T_camera_screen with the six errors of the screen's place, and their twists in camera axes at the camera, (6, 6)."""
    placement: Any = T_camera_screen
    twists = []
    for screw, value in zip(six_screws().T, errors.tolist(), strict=True):
        motion = pin.Motion(screw)
        twists.append(placement.act(motion).vector)
        placement = placement * pin.exp6(motion * value)
    return placement, np.array(twists).T
