"""`urdfcal view`."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from urdfcal.base.errors import CalibrationFileError, UsageError
from urdfcal.cli.console import finish, say, warn
from urdfcal.cli.inputs import load, with_calibration
from urdfcal.cli.measured import measured, rig_file_of
from urdfcal.cli.notes import about
from urdfcal.cli.options import (
    CameraOption,
    Json,
    Lasers,
    Overwrite,
    PackageDirs,
    Quiet,
    Reference,
    ReferenceKnown,
    RigOption,
    RobotFile,
    Screen,
    Target,
    TargetKnown,
    Verbose,
    XacroArgs,
    XacroLimits,
)
from urdfcal.cli.places import deliver, named, require_ending, require_no_json, require_places, stated_place

if TYPE_CHECKING:
    from urdfcal.calibration.analysis.compensation import Compensation
    from urdfcal.output.view.viewer import View
    from urdfcal.robot.robot import Robot


_PORT, _HOST = 7000, "127.0.0.1"


def view(
    robot: RobotFile,
    measurements: Annotated[
        Path | None,
        typer.Argument(
            metavar="MEASUREMENTS",
            help="CSV: a column a joint, and what was measured, or a tour of poses. Without it one pose is shown.",
            show_default=False,
        ),
    ] = None,
    calibrated: Annotated[
        Path | None,
        typer.Option(
            metavar="URDF|YAML",
            help="The calibrated robot, the calibration to put on ROBOT, or a compensation: the robot as it sags. Default: ROBOT alone.",
            show_default=False,
        ),
    ] = None,
    session: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Which session's measurements to show. Default: the first, or all.", show_default=False),
    ] = None,
    html: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            parser=stated_place,
            help="Write one .html page that works offline, and stop; - writes it to stdout. Default: serve it.",
            show_default=False,
        ),
    ] = None,
    magnify: Annotated[
        float | None,
        typer.Option(
            metavar="TIMES", help="How many times longer arrows are than errors. Default: 20, less where they are long.", show_default=False
        ),
    ] = None,
    port: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help=f"Port to serve on; the next free one where it is taken, 0 for any. Default: {_PORT}.",
            show_default=False,
        ),
    ] = None,
    host: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help=f"Address to listen on; 0.0.0.0 lets every machine in the network look. Default: {_HOST}.",
            show_default=False,
        ),
    ] = None,
    overwrite: Overwrite = False,
    no_open: Annotated[bool, typer.Option("--no-open", help="Open no browser.")] = False,
    screen: Screen = None,
    laser: Lasers = None,
    reference: Reference = None,
    reference_known: ReferenceKnown = False,
    target: Target = None,
    target_known: TargetKnown = False,
    camera: CameraOption = None,
    rig: RigOption = None,
    xacro_arg: XacroArgs = None,
    xacro_limit: XacroLimits = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Show robot, beams and screen or targets, measured and predicted, in a browser."""
    from dataclasses import replace

    from urdfcal.output.replaced import inputs_sha256, require_marked
    from urdfcal.output.view.planned import planned_poses, ways_between
    from urdfcal.output.view.server import require_address
    from urdfcal.output.view.viewer import view_of

    if html is not None and (port is not None or host is not None):
        raise UsageError("--port and --host are about serving the page, --html writes it and stops; use one of the two")
    address = (_HOST if host is None else host, _PORT if port is None else port)
    require_address(*address)
    require_no_json(as_json, html)
    rig_file, shown, made_of = rig_file_of(rig, reference_known, target_known), (robot, measurements, calibrated, rig, camera), ""
    arm, data = load(robot, xacro_arg, package_dir, screen, laser, rig_file, xacro_limit=xacro_limit, quiet=quiet), None
    if html is not None:
        html = named(html, f"{arm.description.stem}.html")
        require_places(html, inputs=shown)
        require_ending("--html", html, (".html", ".htm"), "a page")
        made_of = inputs_sha256(shown)
        if not overwrite:
            require_marked(html, ('id="urdfcal-scene"', made_of), "page that urdfcal view has made of the same files")
    options, ways = rig_file.options(), None
    if measurements is not None:
        data = planned_poses(measurements, arm, target, reference or rig_file.reference)
        if data is None:
            arm, data = measured(arm, measurements, rig_file, reference, target, camera)
        else:
            ways, blocked = ways_between(measurements, data)
            data, options = replace(data, warnings=data.warnings + blocked), replace(options, reference_known=True, target_known=True)
    other, bending = (None, None) if calibrated is None else _calibrated(arm, calibrated, package_dir, quiet)
    if session is not None and measurements is None:
        raise UsageError(f"--session {session}: name the measurements that it is of")
    seen = view_of(arm, data, other, magnify, options, bending, session, ways)
    say(verbose, about(seen.scene.robot))
    warn((*(data.warnings if data is not None else ()), *seen.warnings), quiet)
    if html is None:
        _serve(seen, *address, no_open, as_json, quiet)
        return
    page = f"{seen.html}<!-- of {made_of} -->\n".encode()
    deliver({html: page})
    size = len(page)
    finish({"html": str(html), "bytes": size} if as_json else None, f"wrote {html} ({size / 1e6:.1f} MB)", quiet)


def _calibrated(arm: Robot, path: Path, package_dir: list[Path] | None, quiet: bool) -> tuple[Robot, Compensation | None]:
    """The calibrated robot, and how it gives way where that was named."""
    from urdfcal.base.files import is_yaml, read_yaml

    if not is_yaml(path):
        return load(path, None, package_dir, arm.screen, list(arm.lasers) if arm.lasers else None), None
    content = read_yaml(path, CalibrationFileError).content
    if isinstance(content, dict) and content.get("urdfcal") == "compensation":
        from urdfcal.calibration.analysis.compensation import load_compensation

        bending = load_compensation(path, package_dir or ())
        return bending.robot, bending
    return with_calibration(arm, path, quiet), None


def _serve(seen: View, host: str, port: int, no_open: bool, as_json: bool, quiet: bool) -> None:
    with seen.serve(port, host) as server:
        say(port not in (0, server.port), f"urdfcal: port {port} is taken", sys.stderr)
        try:
            finish({"url": server.url, "port": server.port} if as_json else None, f"{server.url} shows the robot; Ctrl-C stops", False)
            sys.stdout.flush()
            if not no_open:
                _open(server.url)
            server.wait()
        except KeyboardInterrupt:
            say(not quiet, "stopped")


def _open(url: str) -> None:
    """Open a browser where there is a desktop; in a bare terminal a text browser would only be in the way."""
    import webbrowser

    if sys.platform == "darwin" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(url)
