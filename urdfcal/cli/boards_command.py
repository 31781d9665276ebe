"""`urdfcal boards`: from pictures of calibration boards to measurements.csv and what rig.yaml says of the boards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from urdfcal.base.errors import InputError
from urdfcal.cli.console import ProgressBar, finish, warn
from urdfcal.cli.notes import listed
from urdfcal.cli.options import Json, Overwrite, Quiet
from urdfcal.cli.places import MEASUREMENTS, STDOUT, deliver, named, require_ending, require_no_json, require_places, stated_place

if TYPE_CHECKING:
    from urdfcal.sensors.camera import Camera
    from urdfcal.vision.camera.board_search import BoardSeen
    from urdfcal.vision.camera.sought import Sought

_Views = dict[str, list["BoardSeen | str"]]
_ENOUGH_TO_SAY = 3  # reasons that are named where nothing is found


def boards(
    pictures: Annotated[
        list[str], typer.Argument(metavar="PICTURES", help="Files, folders or quoted patterns; a picture a pose.", show_default=False)
    ],
    board: Annotated[
        list[str],
        typer.Option(
            metavar="[LINK=]BOARD[@ID]",
            help="9x6:25mm (inner corners), charuco:7x5:40mm:30mm (squares), apriltag:36h11:6x4:30mm[:GAP] or aruco:4X4_50:6x4:30mm[:GAP] "
            "(tags; 1x1 for one; gap by default 0.3 of the tag), circles:4x11:20mm. ID: its first marker's. Repeatable.",
            show_default=False,
        ),
    ],
    camera: Annotated[Path, typer.Option(metavar="CAMERA.yaml", help="The lens, from urdfcal camera.", show_default=False)],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="CSV",
            parser=stated_place,
            help="Measurements; beside them <stem>_rig.yaml. - is stdout, without it.",
            show_default=False,
        ),
    ],
    poses: Annotated[
        Path | None,
        typer.Option(
            metavar="POSES.csv", help="Joint columns; rows by the column image or pose, by order without both.", show_default=False
        ),
    ] = None,
    target: Annotated[
        str | None, typer.Option(metavar="LINK", help="Link that carries a board without LINK=. Default: board.", show_default=False)
    ] = None,
    camera_link: Annotated[
        str | None, typer.Option(metavar="LINK", help="Link that the camera sits on, for rig.yaml.", show_default=False)
    ] = None,
    debug: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Also write each picture with what was found.", show_default=False)
    ] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Find calibration boards in pictures, to sub-pixel, and write their corners as measurements."""
    from urdfcal.base.tables import read_table
    from urdfcal.base.whole_files import folder_whole
    from urdfcal.cli.spots_command import require_debug
    from urdfcal.output.replaced import inputs_sha256, require_marked, require_same
    from urdfcal.vision.camera.board_table import boards_csv, rig_yaml
    from urdfcal.vision.camera.camera_file import read_camera
    from urdfcal.vision.camera.sought import parse_boards
    from urdfcal.vision.pictures import by_pose, picture_files
    from urdfcal.vision.spots.run import drawing_places
    from urdfcal.vision.spots.table import joined

    sought = parse_boards(board, target)
    require_no_json(as_json, output)
    output = named(output, "measurements.csv")
    require_ending("-o", output, MEASUREMENTS, "a file of measurements")
    files = picture_files(pictures)
    rig: dict[str | Path, bytes] = {} if output == STDOUT else {output.with_name(f"{output.stem}_rig.yaml"): rig_yaml(sought, camera_link)}
    beside = [Path(place) for place in rig]
    require_places(output, *beside, inputs=(camera, poses, *files))
    made_of = inputs_sha256((*files, camera, poses))
    if not overwrite:
        require_marked(output, (made_of,), "result of urdfcal boards from the same files")
        require_same(rig)
    groups = by_pose(files, (), "one")
    places = {} if debug is None else drawing_places(groups, debug)
    if debug is not None:
        require_debug(debug, [Path(place) for place in pictures], files, list(places.values()), (output, *beside, camera, poses))
    table = read_table(poses, "a column a joint", "one row a pose") if poses else None
    rows, by_order = joined(groups, table) if table else ([], "")
    views, drawings, notes = _looked(groups, read_camera(camera), sought, places, quiet or as_json)
    _require_found(views, sought, pictures[0])
    told = [
        "corners of boards found in pictures by urdfcal boards; u, v, sigma_px in px, (0, 0) the first pixel's centre; "
        f"sha256 of what they were found in: {made_of}"
    ]
    content = boards_csv(views, sought, table, rows, told)
    if debug is not None:
        with folder_whole(debug) as folder:
            for place, drawing in drawings.items():
                (folder / place.name).write_bytes(drawing)
    deliver({output: content, **rig})
    failed, counts = _failed(views, sought), {one.link: _counts(views, number, one) for number, one in enumerate(sought)}
    warn([*([by_order] if by_order else []), *notes, *failed], quiet)
    machine = {
        "measurements": str(output),
        "rig": [str(place) for place in rig],
        "pictures": len(files),
        "boards": counts,
        "failed": failed,
        "warnings": notes,
    }
    finish(machine if as_json else None, _told(output, beside, len(views), counts), quiet)


def _looked(
    groups: Mapping[str, Sequence[Path]], camera: Camera, sought: Sequence[Sought], places: Mapping[Path, Path], quiet: bool
) -> tuple[_Views, dict[Path, bytes], list[str]]:
    """Boards by the picture's label, drawings by their places, and what is to be said of the boards.

    Raises:
        InputError: a picture cannot be read, or is not this camera's.
    """
    from urdfcal.vision.camera.board_drawing import drawn_boards
    from urdfcal.vision.camera.board_search import BoardSeen, find_boards
    from urdfcal.vision.camera.boards import CharucoBoard
    from urdfcal.vision.pictures import read_grey, require_size

    views: _Views = {}
    drawings: dict[Path, bytes] = {}
    notes, asked = _ambiguous(sought), set[str]()
    with ProgressBar("looking for boards", len(groups), quiet) as advance:
        for label, (path,) in groups.items():
            picture = read_grey(path)
            require_size(path, picture, camera.size, "the camera's")
            views[label] = find_boards(picture, camera, sought)
            for one, view in zip(sought, views[label], strict=True):
                if isinstance(view, BoardSeen) and isinstance(one.board, CharucoBoard) and one.link not in asked:
                    asked.add(one.link)
                    if one.board.is_legacy(picture, one.first):
                        notes.append(f"{one.link}: shows the pattern that OpenCV drew before version 4.6 (legacy); taken as that")
            if path in places:
                drawings[places[path]] = drawn_boards(picture, sought, views[label])
            advance()
    return views, drawings, notes


def _ambiguous(sought: Sequence[Sought]) -> list[str]:
    from urdfcal.vision.camera.board_search import looks_the_same_turned

    return [
        f"{one.link}: {one.board} looks the same turned round; taken as upright in each picture. A board of even by odd inner "
        "corners, circles in an odd number of rows, or a board with markers, cannot be mistaken"
        for one in sought
        if looks_the_same_turned(one.board)
    ]


def _require_found(views: _Views, sought: Sequence[Sought], where: str) -> None:
    """Refuse pictures in which a board is nowhere seen.

    Raises:
        InputError: names the board and the reasons.
    """
    for number, one in enumerate(sought):
        if not any(not isinstance(seen[number], str) for seen in views.values()):
            reasons = list(dict.fromkeys(str(seen[number]) for seen in views.values()))[:_ENOUGH_TO_SAY]
            raise InputError(f"the board of '{one.link}' is seen in none of {len(views)} pictures: {'; '.join(reasons)}", where)


def _failed(views: _Views, sought: Sequence[Sought]) -> list[str]:
    """Pictures that do not show a board, with the reason, and corners that were left out."""
    said = []
    for label, seen in views.items():
        for one, view in zip(sought, seen, strict=True):
            if isinstance(view, str):
                said.append(f"{label}: {one.link} not taken, {view}")
            elif view.wrong:
                said.append(f"{label}: corners {', '.join(map(str, view.wrong))} of {one.link} left out, they are off the board's pose")
    return said


def _counts(views: _Views, number: int, one: Sought) -> dict[str, float | int | str]:
    import numpy as np

    seen = [view for boards in views.values() if not isinstance(view := boards[number], str)]
    sigmas = np.concatenate([view.sigmas for view in seen])
    return {
        "grid": one.in_rig(),
        "pictures": len(seen),
        "corners": sum(len(view.corners) for view in seen),
        "sigma_px": float(np.median(sigmas)),
    }


def _told(output: Path, beside: Sequence[Path], pictures: int, counts: Mapping[str, Mapping[str, float | int | str]]) -> str:
    lines = [f"wrote {listed([output, *beside])}"]
    for link, own in counts.items():
        seen = f"seen in {own['pictures']} of {pictures} pictures, {own['corners']} corners"
        lines.append(f"  {link}: {seen}, sigma {own['sigma_px']:.2f} px")
    return "\n".join(lines)
