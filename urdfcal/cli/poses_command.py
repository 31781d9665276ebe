"""`urdfcal poses`: which poses to measure, and in which order to drive there."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from urdfcal.base.errors import UsageError
from urdfcal.cli.console import Working, finish, say, warn
from urdfcal.cli.help import EXPERT
from urdfcal.cli.inputs import about, listed, load, measured, positive
from urdfcal.cli.options import (
    Json,
    Lasers,
    Overwrite,
    PackageDirs,
    Quiet,
    Reference,
    RobotFile,
    Screen,
    Seed,
    Verbose,
    XacroArgs,
    XacroLimits,
)
from urdfcal.cli.places import (
    MEASUREMENTS,
    deliver,
    named,
    page_place,
    require_ending,
    require_no_json,
    require_places,
    stated_file,
    stated_place,
    told,
)

if TYPE_CHECKING:
    from urdfcal.base.geometry import Mask, Matrix
    from urdfcal.cell.collisions import Cell
    from urdfcal.planning.plan import PosePlan
    from urdfcal.planning.tour import Tour
    from urdfcal.robot.robot import Robot
    from urdfcal.sensors.measurements import Measurements

_TEST = 5  # every such pose is to test on
_THROUGH = 300  # free positions that legs may go around by
_MOST = 200  # poses that --until tries
_PART = 100  # positions that are looked at for collisions before Ctrl-C is heard
_SHORT = "interrupted: these are the best poses so far"
_CUT = "interrupted: legs that were not looked at by then are among those without a way"
_TRAJECTORY = (".yaml", ".yml")


def poses(
    robot: RobotFile,
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="CSV", parser=stated_place, help="Poses as fit reads them; - is stdout.", show_default=False
        ),
    ],
    n: Annotated[int | None, typer.Option("-n", "--poses", min=2, max=_MOST, help="How many. Default: 30.", show_default=False)] = None,
    until: Annotated[
        float | None,
        typer.Option("--until-mm", help="As few as bring the tool's predicted error (RMS) down to this, in mm.", show_default=False),
    ] = None,
    sensor: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND:LINK",
            help="What will measure: laser (the robot's), or point, pose, distance or inclination of a target on LINK; repeatable. "
            "Default: laser.",
            show_default=False,
        ),
    ] = None,
    tool: Annotated[
        str | None, typer.Option(metavar="LINK", help="The link that is to be known. Default: what is measured.", show_default=False)
    ] = None,
    have: Annotated[
        Path | None, typer.Option(metavar="CSV", help="What was measured already: the plan completes it.", show_default=False)
    ] = None,
    scene: Annotated[
        Path | None, typer.Option(metavar="YAML", help="What stands around: boxes, cylinders, planes, meshes.", show_default=False)
    ] = None,
    srdf: Annotated[
        Path | None,
        typer.Option(metavar="SRDF", help="Pairs of links that need no look. Default: the one beside the robot.", show_default=False),
    ] = None,
    clearance_mm: Annotated[float, typer.Option(help="How far all stay apart, in mm.")] = 5.0,
    collisions: Annotated[bool, typer.Option(help="Look for collisions of the robot with itself and the scene.")] = True,
    trajectory: Annotated[
        Path | None,
        typer.Option(
            metavar="YAML",
            parser=stated_file,
            help="Also a ROS 2 JointTrajectory over all poses and the ways around.",
            show_default=False,
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(metavar="HTML", parser=stated_file, help="Also a page of what the poses are worth, to be read.", show_default=False),
    ] = None,
    speed: Annotated[float, typer.Option(help="Of the joints' full speed, in the trajectory.", rich_help_panel=EXPERT)] = 0.2,
    candidates: Annotated[int, typer.Option(min=10, max=20_000, help="Random poses to choose from.", rich_help_panel=EXPERT)] = 1500,
    reference: Reference = None,
    overwrite: Overwrite = False,
    screen: Screen = None,
    laser: Lasers = None,
    xacro_arg: XacroArgs = None,
    xacro_limit: XacroLimits = None,
    package_dir: PackageDirs = None,
    seed: Seed = 0,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Choose poses to measure: those that tell most of the tool, free of collisions, in a short order."""
    from urdfcal.base.interrupts import until_interrupted
    from urdfcal.output.replaced import inputs_sha256, require_marked
    from urdfcal.output.text.poses import plan_csv, plan_json, plan_lines, trajectory_yaml

    require_no_json(as_json, output)
    positive("--speed", speed)
    _require_sense(n, until, scene if not collisions else None, srdf if not collisions else None)
    arm = load(robot, xacro_arg, package_dir, screen, laser, xacro_limit=xacro_limit, quiet=quiet)
    output = named(output, f"{arm.description.stem}_poses.csv")
    require_ending("-o", output, MEASUREMENTS, "a file of poses")
    if trajectory is not None:
        require_ending("--trajectory", trajectory, _TRAJECTORY, "a trajectory")
    places = [output, *([trajectory] if trajectory else [])]
    inputs = {"robot": robot, "measured": have, "scene": scene, "srdf": srdf}
    require_places(*places, inputs=(robot, have, scene, srdf))
    made_of = inputs_sha256((robot, have, scene, srdf))
    if not overwrite:
        for place in places:
            require_marked(place, (made_of,), "result of urdfcal poses from the same files")
    page = page_place(report, f"{arm.description.stem}_poses.html", inputs.values(), made_of, overwrite, *places)
    earlier = measured(arm, have, None, reference)[1] if have else None
    count = min(candidates, _MOST) if until is not None else n or 30
    cells = _Cells(scene, srdf, clearance_mm, seed, count) if collisions else None
    with Working("choosing poses", quiet), until_interrupted() as short:
        plan = _plan(arm, tuple(sensor or ("laser",)), count, until, tool, earlier, cells, candidates, reference, seed)
    with Working("looking at the ways between them", quiet), until_interrupted() as cut:
        tour = _toured(plan, cells)
    say(verbose, about(plan.robot))
    said = [_SHORT] if short() else []
    said += [_CUT] if cut() else []
    said += [*(cells.warnings if cells else ()), *_not_driven(tour)]
    if until is not None and plan.tool_sigma_mm[-1] > until:
        said.append(f"after {len(plan)} poses the tool is predicted to be {plan.tool_sigma_mm[-1]:.3g} mm off, more than {until:g} mm")
    warn(said, quiet)
    files: dict[str | Path, bytes] = {output: plan_csv(plan, tour, _TEST, made_of)}
    if trajectory is not None:
        files[trajectory] = trajectory_yaml(plan, tour, speed, made_of)
    if page is not None:
        from urdfcal.output.report.poses_page import poses_page

        files[page] = poses_page(plan, tour, _TEST, cells.reasons if cells else {}, said, inputs.items(), made_of)
    deliver(files)
    lines = [*plan_lines(plan, tour), f"wrote {listed(told(files))}"]
    finish(plan_json(plan, tour, told(files)) if as_json else None, "\n".join(lines), quiet)
    if short() or cut():
        raise KeyboardInterrupt


def _require_sense(n: int | None, until: float | None, scene: Path | None, srdf: Path | None) -> None:
    """Refuse options that contradict each other.

    Raises:
        UsageError: names them.
    """
    if n is not None and until is not None:
        raise UsageError("-n and --until-mm both say how many poses; use one of the two")
    positive("--until-mm", until)
    for option, path in (("--scene", scene), ("--srdf", srdf)):
        if path is not None:
            raise UsageError(f"{option} is for collisions, which --no-collisions leaves out; use one of the two")


class _Cells:
    """The cell of a robot, made when it is first asked for."""

    def __init__(self, scene: Path | None, srdf: Path | None, clearance_mm: float, seed: int, needed: int) -> None:
        self.scene, self.srdf, self.clearance_mm, self.seed, self.needed = scene, srdf, clearance_mm, seed, needed
        self.made: Cell | None = None
        self.known: list[Matrix] = []  # free positions
        self.looked = 0

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
        self.looked += len(q)
        return free

    def _parts_free(self, q: Matrix) -> Mask:
        """The same part by part; what is left when Ctrl-C comes is taken for not free.

        Raises:
            KeyboardInterrupt: too few were free by then to choose from.
        """
        import numpy as np

        from urdfcal.base.interrupts import enough
        from urdfcal.base.progress import counted

        assert self.made is not None
        free, found = np.zeros(len(q), dtype=bool), sum(map(len, self.known))
        with counted("position", len(q)) as advance:
            for start in range(0, len(q), _PART):
                free[start : start + _PART] = self.made.free(q[start : start + _PART])
                for _ in range(min(_PART, len(q) - start)):
                    advance()
                if enough():
                    break
        if enough() and found + free.sum() < self.needed:
            raise KeyboardInterrupt
        return free

    @property
    def reasons(self) -> dict[str, int]:
        """How many of the positions that were looked at are free, and how many not."""
        free = sum(map(len, self.known))
        return {"are free": free, "touch themselves or what stands around": self.looked - free}

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was left out of it."""
        return self.made.warnings if self.made is not None else ()


def _plan(
    arm: Robot,
    sensors: tuple[str, ...],
    n: int,
    until: float | None,
    tool: str | None,
    earlier: Measurements | None,
    cells: _Cells | None,
    candidates: int,
    reference: str | None,
    seed: int,
) -> PosePlan:
    from urdfcal.planning.plan import plan_poses

    return plan_poses(
        arm,
        candidates=candidates,
        n=n,
        until_mm=until,
        tool=tool,
        sensors=sensors,
        have=earlier,
        allowed=cells.free if cells is not None else None,
        reference=reference,
        seed=seed,
    )


def _toured(plan: PosePlan, cells: _Cells | None) -> Tour:
    """The poses in an order that can be driven."""
    import numpy as np

    from urdfcal.cell.ways import Ways
    from urdfcal.planning.tour import toured

    home = np.zeros(plan.q.shape[1])
    if cells is None or cells.made is None:
        return toured(plan.q, plan.robot, home, None, plan.q[:0])
    through = np.concatenate(cells.known)[:_THROUGH]
    return toured(plan.q, plan.robot, home, Ways(cells.made).free_until, through)


def _not_driven(tour: Tour) -> list[str]:
    legs = [f"{leg + 1} to {leg + 2}" for leg in tour.blocked]
    if not legs:
        return []
    return [f"no free way was found from pose {', '.join(legs)}: drive there by hand, or by a planner"]
