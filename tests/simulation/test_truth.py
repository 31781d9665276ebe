"""Errors as the command line states them."""

from __future__ import annotations

import numpy as np
import pytest

from urdfcal.base.errors import UsageError
from urdfcal.robot.robot import Robot
from urdfcal.simulation.truth import truth_of


def test_zeros_are_no_errors(robots: dict[str, Robot]) -> None:
    """`0mm,0deg` is `none`, and where one of the two is zero the other kind of error is drawn alone."""
    by_word, by_zeros = (truth_of(robots["ur5"], text, np.random.default_rng(0)) for text in ("none", "0mm,0deg"))
    np.testing.assert_array_equal(by_zeros[1], by_word[1])
    assert not by_zeros[1].any()
    model, x = truth_of(robots["ur5"], "0mm,0.1deg", np.random.default_rng(0))
    turned = np.array([".rot_" in name for name in model.names])
    assert x[turned].any()
    assert not x[~turned].any()


@pytest.mark.parametrize("text", ["flat", "-1mm,1deg", "5mm", "1deg,1mm", "nanmm,1deg", "1mm,1e9deg"])
def test_what_is_no_size_of_errors_is_refused_by_its_option(text: str, robots: dict[str, Robot]) -> None:
    """The option, what was found and what is expected."""
    with pytest.raises(UsageError, match=f"--errors {text}: expected a length and an angle such as 2mm,0.2deg, none, or a YAML file"):
        truth_of(robots["ur5"], text, np.random.default_rng(0))
