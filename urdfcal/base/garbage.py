"""How often Python looks for garbage in cycles."""

from __future__ import annotations

import gc


def look_seldom() -> None:
    """Once in 50 000 new objects: modules and fits make many and leave hardly any, and to look for some took a twentieth of a fit."""
    gc.set_threshold(50_000, 5, 5)
