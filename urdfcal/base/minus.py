"""The one minus sign: figures that people read have U+2212, in text and pictures; what machines read, or people copy, has the hyphen."""

from __future__ import annotations

import re

MINUS = "\u2212"
_NEGATIVE = re.compile(r"(?<![\w.-])-(?=\.?\d)|(?<=\de)-(?=\d)")


def with_minus(figures: str) -> str:
    """Figures with a true minus before what is negative, as long as the plus; text that is to be copied stays out of it."""
    return _NEGATIVE.sub(MINUS, figures)
