"""The little pictures of the legend."""

from __future__ import annotations

from urdfcal.view.scene_marks import ERROR, GRID, SHEET, beam_colour

BEAM = 3  # [px] width of a beam


def css(colour: int) -> str:
    """A colour as style sheets have it."""
    return f"#{colour:06x}"


def svg(content: str) -> str:
    """A picture of the size of a line of the legend."""
    return f'<svg viewBox="0 0 26 18" aria-hidden="true">{content}</svg>'


def box(colour: str, opacity: float = 1.0) -> str:
    """A robot, or a sheet."""
    return svg(f'<path d="M5 15V8l8-5 8 5v7h-5v-5h-6v5z" fill="{colour}" opacity="{opacity}"/>')


def grid() -> str:
    """The screen."""
    return svg(
        f'<rect x="4" y="1" width="18" height="16" fill="{css(SHEET)}" stroke="{css(GRID)}"/>'
        f'<path d="M10 1v16M16 1v16M4 6.3h18M4 11.6h18" stroke="{css(GRID)}"/>'
    )


def line(colour: str, width: float, dashes: str = "", opacity: float = 1.0) -> str:
    """A line, dashed on request."""
    return svg(f'<path d="M1 14L25 4" stroke="{colour}" stroke-width="{width:g}" stroke-dasharray="{dashes}" opacity="{opacity}"/>')


def beams(count: int) -> str:
    """One beam or two, in their lasers' colours, the first one above."""
    lines = (
        f'<path d="M1 {9 + 5 * k}L25 {3 + 5 * k}" stroke="{css(beam_colour(k))}" stroke-width="{BEAM}"/>' for k in range(min(count, 2))
    )
    return svg("".join(lines))


def disc(colour: str) -> str:
    """A measured mark."""
    return svg(f'<circle cx="13" cy="9" r="5" fill="{colour}"/>')


def ring(colour: str) -> str:
    """A predicted spot."""
    return svg(f'<circle cx="13" cy="9" r="6" fill="none" stroke="{colour}" stroke-width="2.4"/>')


def arrow() -> str:
    """An error."""
    return svg(f'<path d="M2 9h15" stroke="{css(ERROR)}" stroke-width="2.4"/><path d="M16 4l8 5-8 5z" fill="{css(ERROR)}"/>')


def cross(colour: str, turn: int = 0) -> str:
    """A predicted target, turned by degrees."""
    return svg(f'<path d="M13 3v12M7 9h12" stroke="{colour}" stroke-width="2.6" transform="rotate({turn} 13 9)"/>')


def triad() -> str:
    """A frame."""
    bars = (("#d0342c", "M11 12h11"), ("#2e9e3f", "M11 12V2"), ("#2f5fd0", "M11 12L4 17"))
    return svg("".join(f'<path d="{path}" stroke="{colour}" stroke-width="2"/>' for colour, path in bars))
