"""The cell that `urdfcal poses` plans in, looked at part by part, so that Ctrl-C is heard, and the tour of poses through it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from urdfcal.base.errors import UsageError

if TYPE_CHECKING:
    from urdfcal.base.geometry import Mask, Matrix
    from urdfcal.cell.collisions import Cell
    from urdfcal.planning.plan import PosePlan
    from urdfcal.planning.tour import Tour
    from urdfcal.robot.robot import Robot

_THROUGH = 300  # free positions that legs may go around by
_PART = 100  # positions that are looked at for collisions before Ctrl-C is heard


class Cells:
    """The cell of a robot, made when it is first asked for."""

    def __init__(self, scene: Path | None, srdf: Path | None, clearance_mm: float, seed: int) -> None:
        self.scene, self.srdf, self.clearance_mm, self.seed = scene, srdf, clearance_mm, seed
        self.made: Cell | None = None
        self.known: list[Matrix] = []  # free positions

    def free(self, robot: Robot, q: Matrix) -> Mask:
        """Which positions the robot may take.

        Raises:
            UsageError: none of them, and what is in the way.
        """
        from urdfcal.base.geometry import MM
        from urdfcal.cell.collisions import cell_of

        first = self.made is None
        if self.made is None:
            self.made = cell_of(robot, scene=self.scene, srdf=self.srdf, clearance=self.clearance_mm * MM, seed=self.seed)
        free = self._parts_free(q)
        if first and not free.any():
            way = self.made.most_in_the_way(q)
            raise UsageError(f"none of {len(q)} random poses is free: {way} touch in most; --no-collisions does not look")
        self.known.append(q[free])
        return free

    def hidden(self, robot: Robot, q: Matrix, begin: Matrix, end: Matrix) -> Mask:
        """At which positions something stands between two points, in the axes of the chain's base."""
        from urdfcal.cell.hiding import hidden

        assert self.made is not None  # free was asked first
        return hidden(self.made, q, begin, end)

    def _parts_free(self, q: Matrix) -> Mask:
        """The same part by part; what is left when Ctrl-C comes is taken for not free."""
        import numpy as np

        from urdfcal.base.interrupts import enough
        from urdfcal.base.progress import counted

        assert self.made is not None
        free = np.zeros(len(q), dtype=bool)
        with counted("position", len(q)) as advance:
            for start in range(0, len(q), _PART):
                free[start : start + _PART] = self.made.free(q[start : start + _PART])
                for _ in range(min(_PART, len(q) - start)):
                    advance()
                if enough():
                    break
        return free

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was left out of it."""
        return self.made.warnings if self.made is not None else ()


def toured_in(plan: PosePlan, cells: Cells | None) -> Tour:
    """The poses in an order that can be driven."""
    import numpy as np

    from urdfcal.cell.ways import Ways
    from urdfcal.planning.tour import toured

    home = np.zeros(plan.q.shape[1])
    if cells is None or cells.made is None:
        return toured(plan.q, plan.robot, home, None, plan.q[:0])
    through = np.concatenate(cells.known)[:_THROUGH]
    return toured(plan.q, plan.robot, home, Ways(cells.made).free_until, through)
