"""Equations as MathML, which browsers draw themselves: no script, and nothing to fetch."""

from __future__ import annotations

import html
import re
from typing import Any

from latex2mathml.converter import convert

_INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
_BLOCK = re.compile(r'<div class="arithmatex">\\\[(.*?)\\\]</div>', re.DOTALL)


def on_page_content(content: str, **_: Any) -> str:
    """Turn every equation of a page."""
    content = _INLINE.sub(lambda match: convert(html.unescape(match[1])), content)
    return _BLOCK.sub(lambda match: f'<div class="equation">{convert(html.unescape(match[1]), display="block")}</div>', content)
