"""What is done with frames that were found: links of a URDF made to stand for them, or added."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

from urdfcal.base.errors import RigError, UsageError, did_you_mean, no_such
from urdfcal.base.geometry import xyz_rpy
from urdfcal.robot.corrections import OriginCorrection
from urdfcal.robot.description import Description
from urdfcal.robot.frames import FoundFrame, FrameSite, joint_of
from urdfcal.robot.urdf_tree import UrdfTree
from urdfcal.robot.urdf_writer import numbers, with_elements
from urdfcal.robot.urdf_xml import quoted

_LINK = re.compile(r"[\w./-]+")
NOTE = "frames that urdfcal found with the calibration: what measured, and what was measured"
Site = TypeVar("Site", bound=FrameSite)


@dataclass(frozen=True)
class FramesWish:
    """What is to become of the frames that are found.

    Attributes:
        write: Whether links that stand for them are corrected.
        add: Whether the others become links of their own.
        only: Names of those that are meant, with the name that an added link is to have or the empty string; all if there are none.
    """

    write: bool = False
    add: bool = False
    only: Mapping[str, str] = field(default_factory=dict)

    def __bool__(self) -> bool:
        """Whether anything is to become of any."""
        return self.write or self.add

    def chosen(self, sites: Sequence[Site], tree: UrdfTree) -> Chosen[Site]:
        """Which of the frames are written, and which are added.

        Raises:
            UsageError: there is no such frame, or none that this could be done with.
            RigError: a link of that name is there, or what a frame is on is not.
        """
        if not self:
            return Chosen((), ())
        meant = self._meant(sites)
        for site in meant:
            _require_there(tree, site)
        written = tuple(site for site in meant if self.write and not site.why_not)
        added = tuple(site for site in meant if self.add and site not in written)
        left = [site for site in meant if site not in written and site not in added]
        if left and (self.only or not (written or added)):
            raise UsageError(f"--write-frames: '{left[0].link}' {left[0].why_not}; --add-frames adds it as the link '{left[0].child}'")
        _require_free(tree, added)
        return Chosen(written, added)

    def _meant(self, sites: Sequence[Site]) -> list[Site]:
        option = "--write-frames" if self.write else "--add-frames"
        if not sites:
            raise UsageError(f"{option}: no frame is found beside the joints; what is known, or in the URDF already, is none")
        if not self.only:
            return list(sites)
        found: dict[int, Site] = {}
        for word, child in self.only.items():
            own = [number for number, site in enumerate(sites) if word in site.words]
            if not own:
                raise UsageError(f"--frame {word}: {no_such('frame', word, [site.child for site in sites])}")
            if child and len(own) > 1:
                raise UsageError(f"--frame {word}={child}: means {len(own)} frames: {', '.join(sites[number].child for number in own)}")
            found |= {number: replace(sites[number], child=child or sites[number].child) for number in own}
        return [found[number] for number in sorted(found)]


@dataclass(frozen=True)
class Chosen(Generic[Site]):
    """Frames whose links are corrected, and frames that become links of their own."""

    written: tuple[Site, ...] = ()
    added: tuple[Site, ...] = ()

    def entry(self) -> dict[str, dict[str, str]]:
        """For machines: links that stand for frames, with their joints, and new links, with what they are on."""
        return {
            "written": {frame.link: frame.joint for frame in self.written},
            "added": {frame.child: frame.link for frame in self.added},
        }


NO_FRAMES = FramesWish()


def frames_wish(write: bool, add: bool, names: Iterable[str]) -> FramesWish:
    """What options ask for; a name may have that of the new link behind a `=`.

    Raises:
        UsageError: a name is given, and nothing is to be done, or it is none of a link.
    """
    only = {}
    for word in names:
        own, equals, child = word.partition("=")
        if not (write or add):
            raise UsageError(f"--frame {word}: says which of the frames --write-frames or --add-frames mean; neither is there")
        if equals and not _LINK.fullmatch(child):
            raise UsageError(f"--frame {word}: expected NAME=LINK, LINK of letters, digits, _ . / and -")
        if equals and not add:
            raise UsageError(f"--frame {word}: names a link that is added, which --add-frames does")
        only[own] = child
    return FramesWish(write, add, only)


def _require_there(tree: UrdfTree, site: FrameSite) -> None:
    """Refuse a robot other than the one that the frame was found on."""
    tree.require_link(site.link)
    if site.joint and not ((joint := tree.by_child.get(site.link)) and joint.rigid and joint.name == site.joint):
        raise RigError(f"expected link '{site.link}' on the fixed joint '{site.joint}'{did_you_mean(site.joint, tree.joints)}", tree.label)


def _require_free(tree: UrdfTree, added: Sequence[FrameSite]) -> None:
    taken = {*tree.links, *tree.joints}
    for site in added:
        there = next((name for name in (site.child, joint_of(site.child)) if name in taken), None)
        if there is not None:
            kind = "link" if there in tree.links else "joint"
            raise RigError(f"has a {kind} '{there}' already; name the new link with --frame {site.label}=NAME", tree.label)
        taken |= {site.child, joint_of(site.child)}


def frame_origins(written: Iterable[FoundFrame]) -> dict[str, OriginCorrection]:
    """Nominal and new origin of the joint of every frame's link, by the joint's name."""
    return {frame.joint: frame.origin for frame in written if frame.origin is not None}


def with_frames(description: Description, added: Sequence[FoundFrame]) -> bytes:
    """The description's text with a link and a fixed joint for every frame; all other bytes stay."""
    if not added:
        return description.text
    return with_elements(description, "\n".join(map(_elements, added)), NOTE, {})


def _elements(frame: FoundFrame) -> str:
    xyz, rpy = (numbers(values) for values in xyz_rpy(frame.on_link))
    child, joint, parent = (quoted(name) for name in (frame.child, joint_of(frame.child), frame.link))
    return (
        f'  <link name={child}/>\n  <joint name={joint} type="fixed">\n    <parent link={parent}/>\n    <child link={child}/>\n'
        f'    <origin xyz="{xyz}" rpy="{rpy}"/>\n  </joint>'
    )
