"""Names of columns as people write them, in our own: `tool0_x`, `X_mm` with a target, `JOINT1`, `joint1_deg`, `Set`.

A name that means something as it stands is left alone, and readings are looked for only where no column is one as it stands: what a file
has said so far it goes on saying. What a name is taken for is said; where it could mean two things, it is refused.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

from urdfcal.base.errors import nearest_of
from urdfcal.base.table_layout import UNITS
from urdfcal.base.tables import Table
from urdfcal.robot.robot import Robot
from urdfcal.sensors.pose_columns import APPROACH
from urdfcal.sensors.registry import SENSORS

OF_POSES = ("set", "session", "pose", "payload", "time", "temperature")
ENDINGS = tuple(dict.fromkeys(ending for sensor in SENSORS.values() for ending in sensor.endings))
_NOISE = tuple(dict.fromkeys(sensor.sigma_ending for sensor in SENSORS.values() if sensor.sigma_ending))
_SEPARATORS = "._/ -"
_STATES = ("observation.state.", "/joint_states/")  # before the joint's name in recordings
_POSITIONS = (".position", "/position", "_position")  # behind it
_LEROBOT = ".pos"


def as_people_write(table: Table, robot: Robot, target: str = "") -> Table:
    """A table with the names of its columns as ours.

    Args:
        table: The table.
        robot: Whose joints and links they are named after.
        target: Link that columns named x, y, z, qx ... alone belong to.

    Raises:
        MeasurementError: a name means two things, or two columns mean one.
    """
    names = _Names(table, robot, target)
    taken = {name: found for name in table.names if (found := names.meaning(name)) is not None}
    if not taken:
        return table
    units = {name: unit for name, (_, unit) in taken.items() if unit}
    for name, unit in units.items():
        if table.units.get(name, unit) != unit:
            raise table.fail(None, name, f"its name says {unit} and its unit [{table.units[name]}]; leave one of the two out")
    words = ", ".join(f"'{name}' as '{ours}{f' [{unit}]' if unit else ''}'" for name, (ours, unit) in taken.items())
    note = f"{table.header}: columns are taken: {words}"
    stated = replace(table, units={**table.units, **units}, notes=(*table.notes, note))
    return stated.renamed({name: ours for name, (ours, _) in taken.items()})


def free_names(table: Table, robot: Robot) -> tuple[str, ...]:
    """Columns that mean nothing as they stand, and may be misspelt."""
    names = _Names(table, robot, "")
    return tuple(name for name in table.names if not names.known(name))


def misspelt(name: str, table: Table, robot: Robot) -> str:
    """`; did you mean 'joint_3'?`, of the columns that mean nothing as they stand; else the empty string."""
    return nearest_of(name, free_names(table, robot))


@dataclass(frozen=True)
class _Names:
    """What the names of one table can mean."""

    table: Table
    robot: Robot
    target: str

    def known(self, name: str) -> bool:
        """Whether a name means something as it stands."""
        stated = name.removesuffix(f".{APPROACH}")
        return stated in self.joints or name in OF_POSES or self._is_reading(name)

    def meaning(self, name: str) -> tuple[str, str] | None:
        """Our name for a column, and its unit where its name states one; None where it is ours, or means nothing.

        Raises:
            MeasurementError: it means two things.
        """
        if self.known(name):
            return None
        found = dict.fromkeys((ours, unit) for stem, unit in _stems(name) for ours in self._ours(stem) if ours not in self.table.names)
        if len(found) > 1:
            words = " or ".join(f"'{ours}{f' [{unit}]' if unit else ''}'" for ours, unit in found)
            raise self.table.fail(None, name, f"may mean {words}; write the one that is meant")
        return next(iter(found), None)

    @cached_property
    def joints(self) -> dict[str, None]:
        """Names of the joints that move."""
        return dict.fromkeys(joint.name for joint in self.robot.tree.joints.values() if not joint.rigid)

    @cached_property
    def _read_already(self) -> bool:
        return any(self._is_reading(name) for name in self.table.names)

    def _is_reading(self, name: str) -> bool:
        target, dot, ending = name.rpartition(".")
        target = target.partition("@")[0]
        link = target if target in self.robot.tree.links else target.rpartition(":")[0]
        return bool(dot) and link in self.robot.tree.links and ending in (*ENDINGS, *_NOISE)

    def _ours(self, stem: str) -> Iterator[str]:
        """Everything of ours that a name without its unit can mean."""
        yield from self._joints(stem)
        yield from (word for word in OF_POSES if word == stem.casefold())
        if not self._read_already:
            yield from self._readings(stem)

    def _joints(self, stem: str) -> Iterator[str]:
        bare = stem
        for before in _STATES:
            bare = bare.removeprefix(before)
        for behind in (*_POSITIONS, *((_LEROBOT,) if self._states_unit(stem) else ())):
            bare = bare.removesuffix(behind)
        yield from _alike(bare, self.joints)

    def _states_unit(self, stem: str) -> bool:
        return any(name.startswith(stem) and name in self.table.units for name in self.table.names)

    def _readings(self, stem: str) -> Iterator[str]:
        low = stem.casefold()
        if self.target and low in ENDINGS:
            yield f"{self.target}.{low}"
        for ending in (*ENDINGS, *_NOISE):
            if low.endswith(ending) and stem[: -len(ending)][-1:] in tuple(_SEPARATORS):
                target = stem[: -len(ending) - 1]
                link, colon, label = target.partition(":")
                yield from (f"{own}{colon}{label}.{ending}" for own in _alike(link, self.robot.tree.links))


def _stems(name: str) -> Iterator[tuple[str, str]]:
    """A name as it stands, and without the unit that stands behind it: `x_mm` is x in mm."""
    yield name, ""
    stem, bar, word = name.rpartition("_")
    if bar and stem and word.casefold() in UNITS:
        yield stem.rstrip("_ "), UNITS[word.casefold()]


def _alike(name: str, names: Collection[str]) -> Iterator[str]:
    """The names that are this one, or this one but for its case."""
    if name in names:
        yield name
    else:
        yield from (own for own in names if own.casefold() == name.casefold())
