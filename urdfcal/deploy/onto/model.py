"""Another description of a robot as a calibration sees it: things that are placed, and axes, in its own base at zero."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from urdfcal.base.geometry import SE3
from urdfcal.deploy.onto.text import Edit, Element
from urdfcal.deploy.onto.zero import Axis

Called = Callable[[str], str]  # from a name there to the name that the URDF has


def same_name(name: str) -> str:
    """A name that both have."""
    return name


@dataclass(frozen=True)
class MovingJoint:
    """A joint of one degree of freedom.

    Attributes:
        name: As the URDF has it.
        axis: In the model's base, all joints at zero.
        T_model_body: What it carries, at zero.
        element: Where it stands.
        above: Names of the joints before it, root first; one without a name, or of another kind, is an empty string.
    """

    name: str
    axis: Axis
    T_model_body: SE3
    element: Element
    above: tuple[str, ...]


@dataclass(frozen=True)
class Placed:
    """Something that a calibration may place anew: a body, link, site or frame.

    Attributes:
        names: What it, or the joint that holds it, is called.
        above: Names of the joints that move it, root first.
    """

    element: Element
    names: tuple[str, ...]
    above: tuple[str, ...]
    T_model_own: SE3


class OtherModel(ABC):
    """A description that was read; it knows nothing of the URDF."""

    kind: str
    joints: Mapping[str, MovingJoint]

    @abstractmethod
    def placed(self) -> Iterable[Placed]:
        """All that may be named after a link."""

    @abstractmethod
    def edits(self, follows: Mapping[str, SE3], named: Mapping[Element, SE3]) -> list[Edit]:
        """Numbers that move everything.

        Args:
            follows: The motion of what a joint carries, in the model's base, by the joint's name.
            named: The motion of things that are called like a link.
        """

    @abstractmethod
    def texts(self) -> Mapping[Path, bytes]:
        """The files that it consists of; the one that was named first."""
