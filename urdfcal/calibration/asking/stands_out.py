"""What the residuals say that a model lacks, as a result tells it: what, where, how surely, and what would confirm it."""

from __future__ import annotations

from dataclasses import dataclass

WORDS = {
    "sag": "the joints' sag",
    "payload": "what the payload bends",
    "scale": "the encoders' scale",
    "eccentricity": "the encoders' eccentricity",
    "harmonics": "a gear's harmonic",
    "approach": "the direction of the last move",
    "joint_noise": "noise of the joints' readings",
    "drift": "a rig that drifts",
    "temperature": "the temperature",
    "screen_bow": "a screen that is bowed",
    "lens": "what is left of the lens's distortion",
    "readings_scale": "the scale of all readings",
}
_CONFIRMED_BY = {
    "sag": "the same poses with another payload",
    "payload": "the same poses without it",
    "scale": "one joint alone, moved through its whole range",
    "eccentricity": "one joint alone, through a whole turn in steps of 15 deg",
    "harmonics": "one joint alone, in steps far under a wave",
    "approach": "the same poses visited from the other side",
    "joint_noise": "the same poses read several times",
    "drift": "a `time` column, and the first poses once more at the end",
    "temperature": "the same poses at another temperature",
    "screen_bow": "a straight edge along the screen",
    "lens": "the lens calibrated again, with boards in the corners of the picture",
    "readings_scale": "a length that is known",
}

OF_THE_RIG = frozenset({"joint_noise", "drift", "temperature", "screen_bow", "lens", "readings_scale"})  # the rest is the arm's


@dataclass(frozen=True)
class StandsOut:
    """Something that the residuals say the model lacks.

    Attributes:
        what: A key of WORDS.
        where: The joint; the empty string where it is of all of them, or of the rig.
        gain: Log evidence for it beside all that stand before it, [nats].
        entered: Whether it is in the fit, or in the compensation beside it.
        cycles: A turn of the joint, of a gear's harmonic.
        share: Of what the fit leaves unexplained, which it explains.
    """

    what: str
    where: str
    gain: float
    entered: bool = False
    cycles: int = 0
    share: float = 0.0

    @property
    def in_fit(self) -> bool:
        """Whether it is in the fit itself, of which the calibrated URDF is a part."""
        return self.entered and self.what in OF_THE_RIG

    @property
    def words(self) -> str:
        """`a gear's harmonic, 100 cycles a turn`."""
        return WORDS[self.what] + (f", {self.cycles} cycles a turn" if self.cycles else "")

    @property
    def confirmed_by(self) -> str:
        """Measurements that would tell it better."""
        return _CONFIRMED_BY[self.what]

    def entry(self) -> dict[str, object]:
        """For machines."""
        own: dict[str, object] = {"what": self.what, "where": self.where, "gain_nats": self.gain, "entered": self.entered}
        own |= {"share": self.share, "confirmed_by": self.confirmed_by}
        return own | ({"cycles_a_turn": self.cycles} if self.cycles else {})
