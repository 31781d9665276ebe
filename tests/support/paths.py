"""Where things lie."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]
ROBOTS_DIR = ROOT / "robots"
SHARED_DATA = ROOT.parent / "shared" / "data"
