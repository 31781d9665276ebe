"""Elements of SVG as text: whatever goes into them is escaped."""

from __future__ import annotations

from html import escape

from urdfcal.base.foreign_text import shown


def element(name: str, content: str = "", **attributes: str | float | None) -> str:
    """An element with its attributes; `class_` is `class`, `stroke_width` is `stroke-width`, None leaves one out.

    Args:
        name: Of the element.
        content: Elements that are in it; in a `text` element a word, which is escaped.
        attributes: Text or numbers.
    """
    inside = escape(shown(content), quote=False) if name == "text" else content
    pairs = [f' {key.rstrip("_").replace("_", "-")}="{_value(value)}"' for key, value in attributes.items() if value is not None]
    return f"<{name}{''.join(pairs)}>{inside}</{name}>" if inside else f"<{name}{''.join(pairs)}/>"


def _value(value: str | float) -> str:
    return escape(shown(value)) if isinstance(value, str) else f"{value:.6g}"
