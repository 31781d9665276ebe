"""`python -m urdfcal.cli`."""

from __future__ import annotations

import warnings

from urdfcal.cli.main import main

warnings.simplefilter("default")
main()
