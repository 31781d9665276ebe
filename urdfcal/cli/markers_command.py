"""`urdfcal markers`: boards, or the markers of a screen, to print true to scale."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from urdfcal.base.errors import UsageError
from urdfcal.cli.options import Json, Overwrite, Quiet
from urdfcal.cli.places import deliver, named, require_ending, require_no_json, require_places, stated_place

_PAPERS = "A4|A3|A2|A1|A0|letter|legal|tabloid|WIDTHxHEIGHT|full"
_PRINT = "print at 100 % and check the bar with a ruler"


def markers(
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="SHEET", parser=stated_place, help="A .pdf, .svg or .png file; - is stdout (PDF).", show_default=False
        ),
    ],
    screen: Annotated[
        Path | None, typer.Argument(metavar="SCREEN", help="A screen.yaml: which ArUco marker sits where, in mm.", show_default=False)
    ] = None,
    board: Annotated[
        list[str] | None,
        typer.Option(
            metavar="BOARD[@ID]",
            help="Instead of SCREEN a board, in the words of urdfcal boards: 9x6:25mm, charuco:7x5:40mm:30mm, apriltag:36h11:6x4:30mm, "
            "aruco:4X4_50:6x4:30mm or circles:4x11:20mm[:DIAMETER]. Repeatable, a page each (.pdf).",
            show_default=False,
        ),
    ] = None,
    paper: Annotated[
        str,
        typer.Option(
            metavar=_PAPERS,
            help="full is one page as large as the sheet. Of a screen that does not fit the paper, each page has one marker (.pdf).",
        ),
    ] = "A4",
    dpi: Annotated[float, typer.Option(min=20, max=2400, help="Of a .png, in dots per inch.")] = 300.0,
    mirror: Annotated[bool, typer.Option("--mirror", help="Print SCREEN mirrored, for paper that is put on the screen's back.")] = False,
    overwrite: Overwrite = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Make calibration boards, or the markers of a screen, to print true to scale."""
    from urdfcal.cli.console import finish
    from urdfcal.output.replaced import require_same
    from urdfcal.vision.camera.sheet import ENDINGS, paper_size

    if (screen is None) == (not board):
        raise UsageError("say what to print: a SCREEN.yaml, or --board such as charuco:7x5:40mm:30mm")
    if board and mirror:
        raise UsageError("--mirror is for a SCREEN that is seen from its back; a board is looked at from its front")
    require_no_json(as_json, output)
    output = named(output, "board.pdf" if screen is None else f"{screen.stem}.pdf")
    require_ending("-o", output, tuple(ENDINGS), "a sheet")
    paper_size(paper)
    require_places(output, inputs=(screen,))
    ending = output.suffix.lower() or ".pdf"
    content, count, machine = _boards(board or [], ending, paper, dpi) if screen is None else _screen(screen, ending, paper, dpi, mirror)
    if not overwrite:
        require_same({output: content})
    deliver({output: content})
    finish({"sheet": str(output)} | machine if as_json else None, f"wrote {output} ({count}); {_PRINT}", quiet)


def _boards(texts: list[str], ending: str, paper: str, dpi: float) -> tuple[bytes, str, dict[str, Any]]:
    """The file, what is in it in words, and for machines."""
    from urdfcal.vision.camera.board_sheet import board_pages, board_sheet

    pages = board_pages(texts, paper)
    machine = {
        "pages": len(pages),
        "page_mm": list(pages[0].page),
        "boards": [{"board": one.text, "size_mm": [round(side, 6) for side in one.board]} for one in pages],
    }
    count = "1 board" if len(pages) == 1 else f"{len(pages)} boards"
    return board_sheet(pages, ending, paper, dpi), f"{count} on {_pages(pages[0].page, len(pages))}", machine


def _screen(screen: Path, ending: str, paper: str, dpi: float, mirror: bool) -> tuple[bytes, str, dict[str, Any]]:
    from urdfcal.vision.camera.marker_sheet import marker_sheet, sheet_pages
    from urdfcal.vision.camera.markers import read_screen_markers

    layout = read_screen_markers(screen)
    content, pages = marker_sheet(layout, ending, paper, dpi, mirror), sheet_pages(layout, paper, mirror)
    machine = {"pages": len(pages), "page_mm": list(pages[0].size), "markers": list(layout.centres)}
    return content, f"{len(layout.centres)} markers on {_pages(pages[0].size, len(pages))}", machine


def _pages(size: tuple[float, float], count: int) -> str:
    return f"{count} {'page' if count == 1 else 'pages'} of {size[0]:.0f} x {size[1]:.0f} mm"
