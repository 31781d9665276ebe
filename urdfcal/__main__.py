"""`python -m urdfcal`."""

from __future__ import annotations

from urdfcal.cli.__main__ import start

if __name__ == "__main__":
    start()
