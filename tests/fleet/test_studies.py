"""The road of long studies: each seed made once, and not again when the study is taken up."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

import pytest

from tests.support.studies import over, with_jobs


def drawn(folder: Path, size: int, seed: int) -> int:
    """Something of a seed; a file says that it was made."""
    (folder / f"{size}-{seed}").touch(exist_ok=False)  # not made before
    if seed == 7:
        raise ValueError("seven")
    return size * seed


def test_what_was_made_of_a_seed_is_kept_for_the_same_study_alone(tmp_path: Path) -> None:
    """Stopped half-way and taken up again, each seed is made once, in order; with another size it is another study."""
    parser = argparse.ArgumentParser()
    with_jobs(parser)
    asked = parser.parse_args(["--resume", str(tmp_path / "kept")])
    with pytest.raises(ValueError, match="seven"):
        over(partial(drawn, tmp_path, 3), [1, 2, 7, 9], asked)
    (tmp_path / "3-7").unlink()
    assert over(partial(drawn, tmp_path, 3), [9, 2, 1], asked) == [27, 6, 3]
    assert over(partial(drawn, tmp_path, 4), [1, 2], asked) == [4, 8]
    assert not (tmp_path / "3-7").exists()
