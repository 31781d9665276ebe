"""`urdfcal rig`: what measures, put on a robot that does not have it."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from urdfcal.base.errors import UsageError
from urdfcal.cli.console import finish, say, warn
from urdfcal.cli.inputs import load
from urdfcal.cli.notes import expanded_note, listed
from urdfcal.cli.options import Json, Overwrite, PackageDirs, Quiet, RobotFile, Verbose, XacroArgs, XacroLimits
from urdfcal.cli.places import STDOUT, deliver, named, require_ending, require_no_json, require_places, stated_place, told
from urdfcal.cli.stated import metres_of, numbers_of, parsed_grid, stated_size

if TYPE_CHECKING:
    from urdfcal.robot.added_rig import Piece, Stand
    from urdfcal.robot.rig import Grid
    from urdfcal.robot.robot import Robot

_PLACES = "Where and how large"  # the group of options that say what is otherwise than usual
_LOOKS, _FEW = 20_000, 0.005  # random poses by which it is told whether the beams meet the screen, and the share below which they hardly do


def rig(
    robot: RobotFile,
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="OUT",
            parser=stated_place,
            help="The URDF with the rig; a folder for <robot>_rigged.urdf in it, - for stdout.",
            show_default=False,
        ),
    ],
    tip: Annotated[
        str | None,
        typer.Option(metavar="LINK", help="Link that carries module, board or target, such as tool0.", show_default=False),
    ] = None,
    screen: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="A module with two lasers on the tip, and a screen whose middle is here in the base link, in m.",
            show_default=False,
        ),
    ] = None,
    board: Annotated[
        str | None,
        typer.Option(
            metavar="COLSxROWS:SQUARE",
            help="A board on the tip: a chessboard by its INNER corners, 9x6:25mm, or a ChArUco board by its squares and markers, "
            "10x7:25mm:18mm; or circles:4x11:20mm.",
            show_default=False,
        ),
    ] = None,
    tracker: Annotated[bool, typer.Option("--tracker", help="A reflector or marker on the tip, for a tracker or mocap system.")] = False,
    base: Annotated[
        str | None,
        typer.Option(metavar="LINK", help="Link that screen, camera or tracker stand on. Default: the root.", show_default=False),
    ] = None,
    prefix: Annotated[
        str,
        typer.Option(metavar="TEXT", help="What all new names begin with, as for a second rig: left_.", show_default=False),
    ] = "",
    offset: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Where module, board (its middle) or target sit in the tip's frame, in m. Default: a little before it, a module and a "
            "target beside its axis.",
            show_default=False,
            rich_help_panel=_PLACES,
        ),
    ] = None,
    turn_deg: Annotated[
        str | None,
        typer.Option(
            metavar="R,P,Y",
            help="Roll, pitch, yaw of it in the tip's frame; its z axis is where beams leave, and where a board looks. Default: z leads "
            "away from the arm.",
            show_default=False,
            rich_help_panel=_PLACES,
        ),
    ] = None,
    screen_size_m: Annotated[
        str, typer.Option(metavar="W[,H]", help="Width and height of the screen in m, along its y and z.", rich_help_panel=_PLACES)
    ] = "1.5",
    screen_turn_deg: Annotated[
        str | None,
        typer.Option(
            metavar="R,P,Y",
            help="Roll, pitch, yaw of the screen in the base link; its x axis leads away from the robot. Default: it faces the robot.",
            show_default=False,
            rich_help_panel=_PLACES,
        ),
    ] = None,
    overwrite: Overwrite = False,
    xacro_arg: XacroArgs = None,
    xacro_limit: XacroLimits = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Put a module and a screen, a board or a tracker's target on a robot, without writing URDF or xacro."""
    from urdfcal.base.terminal import many
    from urdfcal.output.replaced import require_same
    from urdfcal.robot.added_rig import require_free, require_moving, with_pieces
    from urdfcal.robot.robot import robot_from

    require_no_json(as_json, output)
    asked = _Asked(tip, screen, board, tracker, offset, turn_deg, screen_turn_deg, screen_size_m)
    asked.require_whole()
    arm = load(robot, xacro_arg, package_dir, xacro_limit=xacro_limit, quiet=quiet)
    output = named(output, f"{arm.description.stem}_rigged.urdf")
    require_ending("-o", output, (".urdf", ".xml"), "a robot description")
    notes = None if output == STDOUT or board is None else output.with_name(f"{output.stem}_rig.yaml")
    require_places(output, *([notes] if notes else []), inputs=(robot,))
    carrier, stands = asked.tip_of(arm), arm.tree.require_link(base) if base else arm.tree.root
    require_moving(arm.tree, carrier, stands)
    pieces = asked.pieces(arm, carrier, stands, prefix)
    require_free(arm.tree, pieces, prefix)
    note = f"Put here by urdfcal rig: {', '.join(piece.links[0] for piece in pieces)}. No mass, no collision shape."
    cell = robot_from(with_pieces(arm, pieces, prefix, note))
    files: dict[str | Path, bytes] = {output: cell.description.text}
    if notes:
        files[notes] = _rig_yaml(output, pieces[-1 - tracker], asked.grid(), base)
    if not overwrite:
        require_same(files)
    warn(_hard_to_hit(cell, pieces, prefix) if screen else (), quiet)
    warn(_lost_meshes(arm, output), quiet)
    deliver(files)
    following = _following(output, notes, pieces, base)
    wide, new = max(len(piece.links[0]) for piece in pieces), sum(len(piece.links) for piece in pieces)
    lines = [f"{piece.links[0]:<{wide}}   {_where(piece)}" for piece in pieces]
    lines += [f"wrote {listed(told(files))}: {many(new, 'new link')}, all else as it was{expanded_note(arm)}", "next:"]
    lines += [f"  {command}" for command in following]
    say(verbose, f"{arm.name} had {len(arm.tree.links)} links and {len(arm.tree.joints)} joints")
    finish(_machine(files, pieces, following) if as_json else None, "\n".join(lines), quiet)


@dataclass(frozen=True)
class _Asked:
    """What the command line asks for."""

    tip: str | None
    screen: str | None
    board: str | None
    tracker: bool
    offset: str | None
    turn_deg: str | None
    screen_turn_deg: str | None
    screen_size_m: str

    def require_whole(self) -> None:
        """Refuse options that ask for nothing, or for two things at one place.

        Raises:
            UsageError: names the options.
        """
        on_tip = [name for name, asked in (("--screen", self.screen), ("--board", self.board), ("--tracker", self.tracker)) if asked]
        if not on_tip:
            raise UsageError("nothing to put on the robot: ask for --screen X,Y,Z (with a module), --board COLSxROWS:SQUARE or --tracker")
        if len(on_tip) > 1 and (self.offset or self.turn_deg):
            raise UsageError(f"--offset and --turn-deg are of one thing on the tip, and {listed(on_tip)} are asked for; run rig for each")
        if self.screen_turn_deg and not self.screen:
            raise UsageError("--screen-turn-deg turns the screen, and --screen X,Y,Z is not asked for")
        self.grid()

    def tip_of(self, arm: Robot) -> str:
        """The link that carries it.

        Raises:
            UsageError: none is named.
            RobotError: there is no such link.
        """
        if self.tip is None:
            raise UsageError(f"name the link that carries it with --tip LINK; the last one of {arm.name} is '{arm.tree.last_link}'")
        return arm.tree.require_link(self.tip)

    def grid(self) -> Grid | None:
        """The inner corners of the board, if there is one."""
        return None if self.board is None else parsed_grid("--board", self.board)

    def pieces(self, arm: Robot, tip: str, base: str, prefix: str) -> list[Piece]:
        """Everything that is put on the robot."""
        from urdfcal.robot.added_rig import Stand, board_on, module_on, screen_on, target_on

        here, grid, found = self._stand(Stand(tip)), self.grid(), []
        if self.screen is not None:
            there = replace(Stand(base), xyz=_place("--screen", self.screen, "its middle in m, such as 1.3,0,0.5"))
            there = replace(there, rpy=_turn("--screen-turn-deg", self.screen_turn_deg))
            size = stated_size(self.screen_size_m, "width and height")
            found += [module_on(arm.tree, here, prefix), screen_on(arm.tree, there, tip, size, prefix)]
        found += [board_on(arm.tree, here, grid, prefix)] if grid is not None else []
        return found + ([target_on(arm.tree, here, prefix)] if self.tracker else [])

    def _stand(self, stand: Stand) -> Stand:
        xyz = None if self.offset is None else _place("--offset", self.offset, "a place in m, such as 0.05,0,0.02")
        return replace(stand, xyz=xyz, rpy=_turn("--turn-deg", self.turn_deg))


def _place(option: str, text: str, expected: str) -> Any:
    import numpy as np

    return np.array(metres_of(option, text, (3,), expected))


def _turn(option: str, text: str | None) -> Any:
    import numpy as np

    expected = "roll, pitch and yaw in deg, such as 0,90,0"
    return None if text is None else np.radians(numbers_of(option, text, (3,), expected))


def _where(piece: Piece) -> str:
    """`on tool0 at 50, 0, 20 mm: its beams leave ...`."""
    at = ", ".join(f"{value * 1e3 + 0.0:.9g}" for value in piece.placement.translation.round(9))
    return f"on {piece.parent} at {at} mm: {piece.words}"


def _rig_yaml(output: Path, board: Piece, grid: Grid | None, base: str | None) -> bytes:
    """What a fit has to know of the board, and of the link that the camera stands on."""
    import yaml

    entries: dict[str, Any] = {"boards": {board.links[0]: str(grid)}} | ({"reference": base} if base else {})
    head = f"# for {output.name}, written by urdfcal rig: which link is a board, by its inner corners and the side of a square\n"
    return (head + yaml.safe_dump(entries, sort_keys=False, allow_unicode=True)).encode()


def _following(output: Path, notes: Path | None, pieces: list[Piece], base: str | None) -> list[str]:
    """What to type next: look at it, and try it out with simulated measurements."""
    cell = "cell.urdf" if output == STDOUT else shlex.quote(str(output))
    links = {piece.macro: piece.links for piece in pieces}
    given = [word for laser in links.get("slm", ())[1:] for word in ("--laser", laser) if laser not in ("laser_1", "laser_2")]
    given += ["--screen", links["screen"][0]] if links.get("screen", ("screen",))[0] != "screen" else []
    rig = " ".join(["", *given])
    if "slm" in links:
        ways = (f"-o try.csv{rig}", f"try.csv{rig}")
    elif "board" in links:
        boards = f" --rig {shlex.quote(str(notes or 'rig.yaml'))}"
        ways = (f"-o try.csv{boards}", f"try.csv --camera try_camera.yaml{boards}")
    else:
        reference = f" --reference {shlex.quote(base)}" if base else ""
        ways = (f"-o try.csv --sensor point:{links['target'][0]}{reference}", f"try.csv{reference}")
    return [f"urdfcal view {cell}{rig}", f"urdfcal simulate {cell} {ways[0]}", f"urdfcal fit {cell} {ways[1]}"]


def _hard_to_hit(cell: Robot, pieces: list[Piece], prefix: str) -> list[str]:
    """A warning where hardly any pose within the joints' limits puts both beams on the screen."""
    import numpy as np

    from urdfcal.calibration.reach import draw_where, on_screen, screen_area
    from urdfcal.model.gauge import build_error_model
    from urdfcal.robot.configurations import joint_limits, without_room

    seen = replace(cell, screen=f"{prefix}screen", lasers=(f"{prefix}laser_1", f"{prefix}laser_2"))
    if without_room(seen):
        return []
    errors = build_error_model(seen.chain, seen.rig)
    good = on_screen(errors, errors.mean, screen_area(seen))
    drawn = draw_where(good, joint_limits(seen), _LOOKS, np.random.default_rng(0), most=_LOOKS, batch=_LOOKS)
    share = len(drawn.q) / drawn.looked
    way_out = "move it, make it larger, or turn the module"
    return [f"{share:.1%} of random poses put both beams on the screen: {way_out}"] if share < _FEW else []


def _lost_meshes(arm: Robot, output: Path) -> list[str]:
    """A warning where meshes are named relative to a folder that the new file is not in."""
    import re

    away = output == STDOUT or output.resolve().parent != arm.description.path.resolve().parent
    named = re.findall(rb"""<mesh\s[^>]*?filename\s*=\s*["']([^"':]+)["']""", arm.description.text)
    relative = [name.decode(errors="replace") for name in named if not name.startswith(b"/")]
    if not away or not relative:
        return []
    home = arm.description.path.name
    return [f"meshes such as {relative[0]} are named from the folder of {home}; only beside it is the new file drawn with them"]


def _machine(files: dict[str | Path, bytes], pieces: list[Piece], following: list[str]) -> dict[str, Any]:
    """The result for machines, SI."""
    from urdfcal.base.geometry import xyz_rpy

    added = []
    for piece in pieces:
        xyz, rpy = xyz_rpy(piece.placement)
        added.append({"link": piece.links[0], "links": list(piece.links), "on": piece.parent, "xyz": xyz.tolist(), "rpy": rpy.tolist()})
    return {"files": told(files), "added": added, "next": following}
