"""The meshcat tab: robot, beams and screen or targets, measured and predicted, as a page of its own, a server, or a notebook's cell.

view = urdfcal.viewer.view_of(robot, data, calibrated)
view.write_html("view.html"); view.serve(); view          # the last line of a notebook's cell shows it
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.base.files import write_whole
from urdfcal.base.geometry import Matrix
from urdfcal.base.terminal import many
from urdfcal.calibration.reach import draw_poses
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.options import ModelOptions
from urdfcal.output.view.rows import before_its_screen, bent_positions, has_another_screen, of_session
from urdfcal.output.view.scene import Scene
from urdfcal.output.view.server import PageServer
from urdfcal.output.view.shapes import Shapes, robot_shapes
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.rig import Instruments, Target, lasers_by_name
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import (
    Measurements,
    as_measured,
    as_spots,
    in_pixels,
    require_screen_of_camera,
    spots_measured,
    unreached_words,
)

if TYPE_CHECKING:
    from urdfcal.calibration.analysis.compensation import Compensation

_DRAWN = 200  # random poses, of which the one nearest to the middle of the joints' limits is shown


@dataclass(frozen=True, repr=False)
class View:
    """A scene that can be looked at.

    Attributes:
        scene: What there is to see.
        warnings: What the user ought to know.
    """

    scene: Scene
    shapes: Shapes
    warnings: tuple[str, ...] = ()

    @cached_property
    def html(self) -> str:
        """One page that needs nothing else, no network either."""
        from urdfcal.output.view.page import page_of

        return page_of(self.scene, self.shapes)

    def write_html(self, path: str | Path) -> None:
        """Write the page, whole or not at all."""
        write_whole(path, self.html.encode())

    def serve(self, port: int = 7000, host: str = "127.0.0.1") -> PageServer:
        """Serve the page from now on, on this port or the next free one; its `url` is where, and it stops at `close()`."""
        return PageServer(self.html.encode(), host, port)

    def __repr__(self) -> str:
        """In a line: the whole of it holds meshes and every pose."""
        robots = "before and after" if self.scene.calibrated is not None else "as its URDF has it"
        poses = many(len(self.scene.data), "pose")
        return f"<{type(self).__name__} of {self.scene.robot.name}, {robots}: {poses}; .serve() or .write_html(FILE) to look at it>"

    def _repr_html_(self) -> str:
        """In a notebook, whose own scripts and files the page cannot reach."""
        frame = "width: 100%; height: 640px; border: 1px solid #d5dade; border-radius: 6px"
        return f'<iframe title="urdfcal view" sandbox="allow-scripts" style="{frame}" srcdoc="{escape(self.html)}"></iframe>'


def view_of(
    robot: Robot,
    data: Measurements | None = None,
    calibrated: Robot | None = None,
    magnify: float | None = None,
    options: ModelOptions | None = None,
    compensation: Compensation | None = None,
    session: str | None = None,
    planned: Mapping[int, Matrix] | None = None,
) -> View:
    """Put robot, beams, screen, spots and targets into a scene.

    Args:
        robot: As its URDF has it.
        data: What was measured; without it, one pose is shown, with every beam on the screen if there is such a pose.
        calibrated: The same robot as it was found to be.
        magnify: How many times longer than the errors their arrows are; by default 20, or less where they would be too long.
        options: Of which only what concerns the instruments matters, as for `evaluate`.
        compensation: How the calibrated robot gives way, of whose joint fit it is.
        session: Which session's measurements are shown; by default the first one's, or those of all where that can be.
        planned: Of poses that were planned and not measured, where the way behind some rows goes by, (k, inputs), [rad] or [m].

    Raises:
        ShapeMismatch: the two robots do not have the same joints and lasers, or the measurements are another robot's.
        UsageError: the magnification is not above zero, targets cannot be placed, or there is no such session.
    """
    if magnify is not None and not 0 < magnify < np.inf:
        raise UsageError(f"the magnification must be above zero, found {magnify:g}")
    said: list[str] = []
    if compensation is not None:
        calibrated = calibrated or compensation.robot
    if data is None and session is not None:
        raise UsageError(f"session '{session}': there are no measurements that it could be of")
    if data is not None:
        data = _drawable(data)
        robot, calibrated = as_measured(robot, data), as_measured(calibrated, data) if calibrated is not None else None
    elif not (robot.lasers or robot.instruments.targets or lasers_by_name(robot.tree)):
        robot, calibrated = _to_its_tip(robot), _to_its_tip(calibrated) if calibrated is not None else None
    rows = _one_pose(robot) if data is None else data
    _check(robot, calibrated, rows)
    rows, words = of_session(rows, session, together=calibrated is None and rows.only_spots)
    said += words
    if calibrated is not None and data is not None and has_another_screen(calibrated, rows, data):
        calibrated = before_its_screen(calibrated, rows)
        said.append(f"the screen of session '{rows.session_names[0]}' stands where it suits the calibrated robot best")
    bent = None if compensation is None else bent_positions(compensation, rows)
    scene = Scene(robot, calibrated, rows, magnify, options, bent, planned)
    shapes = robot_shapes(scene.solid)
    return View(scene, shapes, (*said, *_missing(scene), *_overlong(scene), *shapes.warnings))


def _to_its_tip(robot: Robot) -> Robot:
    """A robot that nothing measures: the joints to the link that most of them move are those that count."""
    tip = max(robot.tree.links, key=lambda link: sum(joint.moves for joint in robot.tree.path_from_root(link)))
    return robot.seen_by(Instruments((Target(tip, tip),)), ())


def _drawable(data: Measurements) -> Measurements:
    """The same with spots in pixels where the camera has them on the screen."""
    if not in_pixels(data):
        return data
    require_screen_of_camera(data)
    beside = (each for each in data.readings if not each.kind.beam)
    return replace(data, readings=(*as_spots(data).readings, *beside))


def _missing(scene: Scene) -> list[str]:
    marks = [mark for mark in scene.placed[-1].marks if mark.on_screen]
    lost = np.array([mark.was_read & np.isnan(mark.predicted[:, 0]) for mark in marks]).T
    words = unreached_words(scene.data, lost, [mark.target for mark in marks], "the robot that is drawn")
    return [words] if words else []


def _overlong(scene: Scene) -> list[str]:
    most = scene.most_magnification
    if scene.magnify is None or scene.magnify <= most:
        return []
    decade = 10.0 ** np.floor(np.log10(most))
    fits, over = float(np.floor(most / decade) * decade), scene.magnify / most
    return [
        f"arrows {scene.magnify:g} times longer than the errors are up to {over:.1f} times as long as the scene; "
        f"up to {fits:g} times they fit"
    ]


def _check(robot: Robot, calibrated: Robot | None, data: Measurements) -> None:
    if (data.joints, data.lasers) != (robot.chain.input_names, robot.rig.lasers):
        raise ShapeMismatch(f"the measurements are of {', '.join((*data.joints, *data.lasers))}; the robot has {_inputs(robot)}")
    if calibrated is not None and _inputs(calibrated) != _inputs(robot):
        raise ShapeMismatch(
            f"{calibrated.description.label}: has {_inputs(calibrated)}; the robot it is compared with has {_inputs(robot)}"
        )


def _inputs(robot: Robot) -> str:
    return ", ".join((*robot.chain.input_names, *robot.rig.lasers))


def _one_pose(robot: Robot) -> Measurements:
    """A pose with nothing measured: near the middle of the limits, and one at which all beams meet the screen, if that is found."""
    limits = joint_limits(robot)
    middle, half = limits.mean(axis=0), np.maximum(np.ptp(limits, axis=0) / 2, 1e-9)
    try:
        drawn = draw_poses(robot, ErrorModel(robot.chain, (), ()), np.empty(0), _DRAWN, np.random.default_rng(0))
    except UsageError:
        drawn = middle[None]
    q = drawn[np.argmin(np.linalg.norm((drawn - middle) / half, axis=1))][None]
    return spots_measured(robot, q, np.full((1, len(robot.rig.lasers), 2), np.nan), poses=["shown"])
