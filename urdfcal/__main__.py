"""`python -m urdfcal`."""

from __future__ import annotations

import urdfcal.cli.__main__  # noqa: F401
