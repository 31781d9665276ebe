"""`urdfcal camera`: the lens, and the screen in front of it."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from urdfcal.base.errors import InputError, UsageError
from urdfcal.base.files import YAML_ENDINGS
from urdfcal.cli.console import ProgressBar, say, show, warn
from urdfcal.cli.options import Json, Overwrite, Quiet, Verbose
from urdfcal.cli.places import deliver, named, require_ending, require_no_json, require_places, stated_place

if TYPE_CHECKING:
    from urdfcal.sensors.camera import Camera, Side
    from urdfcal.sensors.lenses import Lens
    from urdfcal.vision.camera.boards import Board, BoardView
    from urdfcal.vision.camera.lens import LensFit
    from urdfcal.vision.camera.screen_pose import ScreenFit


def camera(
    output: Annotated[
        Path,
        typer.Option("-o", "--output", metavar="CAMERA.yaml", parser=stated_place, help="Where to write; - is stdout.", show_default=False),
    ],
    images: Annotated[
        list[str] | None,
        typer.Argument(metavar="IMAGES", help="Views of a board: files, folders or quoted patterns ('views/*.png').", show_default=False),
    ] = None,
    board: Annotated[
        str | None,
        typer.Option(
            metavar="BOARD",
            help="Chessboard by its INNER corners, e.g. 9x6:25mm (10 x 7 squares; mm, cm or m); charuco:7x5:40mm:30mm (squares); "
            "circles:4x11:20mm (every second row shifted).",
            show_default=False,
        ),
    ] = None,
    charuco: Annotated[
        str | None,
        typer.Option(
            metavar="COLSxROWS:SQUARE:MARKER[:DICT]",
            help="The same as --board charuco:..., e.g. 10x7:25mm:18mm:DICT_4X4_50. DICT by default DICT_4X4_50.",
            show_default=False,
        ),
    ] = None,
    distortion: Annotated[str, typer.Option(metavar="auto|plain|rational", help="plain: 5 numbers, rational: 8, auto: by BIC.")] = "auto",
    fisheye: Annotated[bool, typer.Option("--fisheye", help="A fisheye lens (Kannala-Brandt, 4 numbers).")] = False,
    lens: Annotated[
        Path | None,
        typer.Option(metavar="CAMERA.yaml", help="Take the lens from there instead of IMAGES, and add the screen.", show_default=False),
    ] = None,
    screen: Annotated[
        Path | None, typer.Option(metavar="IMAGE", help="Picture of the screen with its markers, or the board on it.", show_default=False)
    ] = None,
    markers: Annotated[
        Path | None, typer.Option(metavar="SCREEN.yaml", help="Which ArUco marker sits where on the screen, in mm.", show_default=False)
    ] = None,
    screen_board: Annotated[
        str | None,
        typer.Option(
            metavar="COLSxROWS:SQUARE",
            help="Instead of markers: a chessboard laid on the screen, columns level, rows down.",
            show_default=False,
        ),
    ] = None,
    board_origin: Annotated[
        str | None,
        typer.Option(
            metavar="Y,Z",
            help="Of that board: its first inner corner, top left as seen from the front, as y,z on the screen in mm. The camera is "
            "taken to be upright within 90 deg.",
            show_default=False,
        ),
    ] = None,
    side: Annotated[
        str, typer.Option(metavar="front|back", help="Of that board: back where the camera looks through the screen.")
    ] = "front",
    overwrite: Overwrite = False,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Calibrate a camera: its lens from views of a board, and where the screen is."""
    from urdfcal.output.replaced import inputs_sha256, require_marked
    from urdfcal.vision.camera.camera_file import camera_yaml, read_camera
    from urdfcal.vision.camera.report import camera_json, lens_blocks, lens_warnings, screen_blocks, screen_warnings
    from urdfcal.vision.pictures import picture_files

    sought = _board_of(images, board, charuco, lens)
    model = _model_of(distortion, fisheye, lens)
    _require_screen(screen, markers, screen_board, board_origin, side, lens)
    require_no_json(as_json, output)
    output = named(output, "camera.yaml")
    require_ending("-o", output, YAML_ENDINGS, "a camera")
    views = picture_files(images) if images else []
    require_places(output, inputs=(screen, markers, lens, *views))
    made_of = inputs_sha256((*views, lens, screen, markers))
    if not overwrite:
        require_marked(output, (made_of,), "camera that was calibrated from the same files")
    fit: LensFit | None = None
    failed: dict[str, str] = {}
    if sought is not None:
        fit, failed = _lens(images or [], sought, model, quiet, verbose)
        warn([f"{name}: left out, {why}" for name, why in failed.items()] + lens_warnings(fit), quiet)
    found = fit.camera if fit is not None else read_camera(cast("Path", lens))
    seen = None
    if screen is not None:
        seen = _screen(found, screen, markers, screen_board, board_origin, cast("Side", side), "the views" if fit else str(lens))
        warn(screen_warnings(seen, screen.name), quiet)
    result = seen.camera if seen is not None else found
    deliver({output: camera_yaml(result, {**_provenance(fit, screen), "inputs_sha256": made_of})})
    blocks: list[Any] = [*(lens_blocks(fit) if fit else []), *([""] if fit and seen else []), *(screen_blocks(seen) if seen else [])]
    show(camera_json(result, fit, failed, seen) if as_json else None, blocks if quiet else [*blocks, "", f"wrote {output}"])


def _board_of(images: list[str] | None, board: str | None, charuco: str | None, lens: Path | None) -> Board | None:
    """The board that is looked for; None where the lens is given.

    Raises:
        UsageError: the options do not go together.
    """
    from urdfcal.vision.camera.boards import parse_charuco
    from urdfcal.vision.camera.sought import parse_lens_board

    if lens is not None:
        if images or board or charuco:
            raise UsageError("--lens takes the lens from a file: leave out IMAGES, --board and --charuco")
        return None
    if not images:
        raise UsageError("no views; name pictures of a board, or --lens CAMERA.yaml to add a screen to a known lens")
    if (board is None) == (charuco is None):
        raise UsageError("say which board the views show: --board 9x6:25mm (inner corners) or --charuco 10x7:25mm:18mm (squares)")
    return parse_lens_board(board) if board is not None else parse_charuco(cast("str", charuco))


def _model_of(distortion: str, fisheye: bool, lens: Path | None) -> Lens | None:
    """The lens model that was asked for; None: by evidence.

    Raises:
        UsageError: there is no such model, or two were asked for.
    """
    if distortion not in ("auto", "plain", "rational"):
        raise UsageError(f"--distortion {distortion}: expected auto, plain or rational (or --fisheye)")
    if fisheye and distortion != "auto":
        raise UsageError(f"--fisheye and --distortion {distortion}: expected one of them")
    if lens is not None and (fisheye or distortion != "auto"):
        raise UsageError("--lens has a lens model already: leave out --fisheye and --distortion")
    return "fisheye" if fisheye else None if distortion == "auto" else cast("Lens", distortion)


def _require_screen(
    screen: Path | None, markers: Path | None, screen_board: str | None, board_origin: str | None, side: str, lens: Path | None
) -> None:
    """Refuse options of the screen that do not go together."""
    if screen is None:
        if lens is not None:
            raise UsageError("--lens needs --screen IMAGE: there is nothing else to add to a known lens")
        if markers is not None or screen_board is not None or board_origin is not None:
            raise UsageError("--markers, --screen-board and --board-origin need --screen IMAGE, a picture of the screen")
        return
    if (markers is None) == (screen_board is None):
        raise UsageError("say what is on the screen: --markers SCREEN.yaml, or --screen-board 9x6:25mm with --board-origin Y,Z")
    if (screen_board is None) != (board_origin is None):
        raise UsageError("--screen-board and --board-origin belong together")
    if side not in ("front", "back"):
        raise UsageError(f"--side {side}: expected front or back")
    if markers is not None and side != "front":
        raise UsageError(f"--side {side} is for --screen-board; with markers, write `side: {side}` into {markers}")


def _lens(images: Sequence[str], board: Board, model: Lens | None, quiet: bool, verbose: bool) -> tuple[LensFit, dict[str, str]]:
    """The lens, and the views that show no board with the reason."""
    from urdfcal.vision.camera.lens import FEWEST, calibrate_lens
    from urdfcal.vision.pictures import picture_files

    files = picture_files(images)
    views, failed, size = _views(files, board, quiet, verbose)
    if len(views) < FEWEST:
        named = "; ".join([*_grouped(failed), *_other_size(files, board)])
        count = f"{len(views) or 'none'} of {len(files)} {'picture shows' if len(files) == 1 else 'pictures show'} the board"
        raise InputError(f"{count}, expected {FEWEST} or more (10 to 20 are good){f'; {named}' if failed else ''}", images[0])
    return calibrate_lens(views, size, model), failed


def _grouped(failed: dict[str, str]) -> list[str]:
    """`why (first.png and 11 more)` for every reason."""
    reasons: dict[str, list[str]] = {}
    for name, why in failed.items():
        reasons.setdefault(why, []).append(name)
    return [f"{why} ({names[0]}{f' and {len(names) - 1} more' if names[1:] else ''})" for why, names in reasons.items()]


def _other_size(files: Sequence[Path], board: Board) -> list[str]:
    """The board that the first views do show, if it is a chessboard of nearly that size."""
    from urdfcal.vision.camera.boards import Chessboard
    from urdfcal.vision.pictures import read_grey

    for path in files[:2]:
        if not isinstance(board, Chessboard):
            break
        other = board.other_size(read_grey(path))
        if other is not None:
            return [
                f"{path.name} shows {other.columns} x {other.rows}: is it --board {other.columns}x{other.rows}:{board.square * 1e3:g}mm?"
            ]
    return []


def _views(files: Sequence[Path], board: Board, quiet: bool, verbose: bool) -> tuple[list[BoardView], dict[str, str], tuple[int, int]]:
    from urdfcal.vision.pictures import read_grey, require_size, size_of

    views, failed, size = [], {}, (0, 0)
    with ProgressBar("looking for the board", len(files), quiet) as advance:
        for path in files:
            picture = read_grey(path)
            size = size if any(size) else size_of(picture)
            require_size(path, picture, size, str(files[0]))
            found = board.find(picture, path.name)
            if isinstance(found, str):
                failed[path.name] = found
            else:
                views.append(found)
                say(verbose and not quiet, f"{path.name}: {len(found.pixels)} corners")
            advance()
    return views, failed, size


def _screen(
    camera: Camera, picture_file: Path, markers: Path | None, board: str | None, origin: str | None, side: Side, whose: str
) -> ScreenFit:
    from urdfcal.vision.camera.boards import parse_chessboard
    from urdfcal.vision.camera.markers import read_screen_markers
    from urdfcal.vision.camera.screen_pose import screen_from_board, screen_from_markers
    from urdfcal.vision.pictures import read_grey, require_size

    layout = None if markers is None else read_screen_markers(markers)
    laid = None if board is None else (parse_chessboard(board, "--screen-board"), _origin(cast("str", origin)))
    picture = read_grey(picture_file)
    require_size(picture_file, picture, camera.size, whose)
    if layout is not None:
        return screen_from_markers(camera, picture, layout, str(picture_file))
    chessboard, corner = cast("tuple[Any, tuple[float, float]]", laid)
    return screen_from_board(camera, picture, chessboard, corner, side, str(picture_file))


def _origin(text: str) -> tuple[float, float]:
    """`550,400` in mm as metres.

    Raises:
        UsageError: it is no pair of numbers.
    """
    try:
        y, z = (float(number) * 1e-3 for number in text.replace("mm", "").split(","))
    except ValueError:
        raise UsageError(f"--board-origin {text}: expected Y,Z in mm such as 120,85") from None
    if not (abs(y) <= 100 and abs(z) <= 100):
        raise UsageError(f"--board-origin {text}: expected numbers within 100000 mm")
    return y, z


def _provenance(fit: LensFit | None, screen: Path | None) -> dict[str, Any]:
    from urdfcal.base.version import __version__

    entry: dict[str, Any] = {"urdfcal": __version__, "command": _readable(shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]]))}
    if fit is not None:
        entry["views"] = {_readable(view.name): round(float(rms), 4) for view, rms in zip(fit.views, fit.view_rms, strict=True)}
        entry["left_out"] = {_readable(name): round(rms, 4) for name, rms in fit.dropped}
    if screen is not None:
        entry["screen_picture"] = _readable(screen.name)
    return entry


def _readable(text: str) -> str:
    """A path as text, also where its bytes are no UTF-8."""
    return text.encode("utf-8", "backslashreplace").decode()
