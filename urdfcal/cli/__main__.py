"""`python -m urdfcal.cli`."""

from __future__ import annotations

import warnings
from typing import NoReturn

from urdfcal.cli.main import main


def start() -> NoReturn:
    """The command line, with Python's own warnings shown."""
    warnings.simplefilter("default")
    main()


if __name__ == "__main__":
    start()
