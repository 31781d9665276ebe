"""Foreign text (names, labels, paths, messages of libraries) as it may be sent to a terminal."""

from __future__ import annotations

import re

_STEERING = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ufeff\U000e0000-\U000e007f]")


def shown(text: str) -> str:
    r"""Text as it may be sent to a terminal: what would steer it, or turn letters about, as `\x1b` or `\u202e`; line ends and tabs stay."""
    return _STEERING.sub(lambda found: found[0].encode("unicode_escape").decode(), text)
