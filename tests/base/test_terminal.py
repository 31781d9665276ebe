# ruff: noqa: E501
"""Numbers and lines as people read them."""

from __future__ import annotations

import re

import pytest

from urdfcal.base.terminal import as_text, decimals, distance, figures_table, many, rounded, value_and_sigma


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [(163.2, 2, "160"), (1234567.0, 3, "1230000"), (-163.2, 2, "\u2212160"), (99.6, 2, "1e+02"), (0.01234, 2, "0.012"), (12.0, 3, "12"), (2e12, 2, "2e+12")],
)  # fmt: skip
def test_numbers_are_rounded_as_people_write_them(value: float, digits: int, text: str) -> None:
    """So many digits count, without an exponent unless the number is out of all bounds."""
    assert rounded(value, digits) == text.replace("1e+02", "100")


def test_figures_in_tables_have_a_true_minus() -> None:
    """And those in sentences; names in the columns of words stay as they are."""
    assert value_and_sigma(-1.0, 0.25) == "\u22121.000 ± 0.250"
    table = figures_table("pose")
    table.add_column("value", justify="right")
    table.add_row("-3", "-3.0")
    assert as_text([table]).splitlines()[-1].split() == ["-3", "\u22123.0"]


def test_sentences_break_between_words() -> None:
    """At 30 columns no line is longer, no word is broken, further lines are indented, and blank lines stay; without a width all stays."""
    sentence = "  the measurements move with 27 of 28 directions"
    assert as_text([sentence, "", "end"], 30) == "  the measurements move with\n    27 of 28 directions\n\nend\n"
    assert as_text([sentence, "", "end"]) == f"{sentence}\n\nend\n"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0.000"),
        (0.000162, "0.00016"),
        (1.62e-5, "0.000016"),
        (0.0094, "0.0094"),
        (1.2274, "1.227"),
        (99.9, "99.900"),
        (228.61, "228.6"),
    ],
)
def test_distances_of_any_size_are_told(value: float, text: str) -> None:
    """A thousandth where that says something, two digits that count below, a tenth above; no exponents."""
    assert distance(value) == text


def test_one_is_one() -> None:
    """What is counted has its s where there are several of it, or none."""
    assert [many(count, "pose") for count in (0, 1, 2)] == ["0 poses", "1 pose", "2 poses"]


def test_long_names_are_broken_where_their_parts_end() -> None:
    """Numbers keep their digits; names give way behind dots and underscores, sentences between words, and nothing is lost."""
    name, what = "left_arm_shoulder_pitch_joint_of_the_second_robot.d_alpha", "a sentence that says more than fits beside it"
    table = figures_table("parameter", "what")
    table.add_column("value ± sigma", justify="right")
    table.add_row(name, what, "+10.23456 ± 0.12345")
    lines = as_text([table]).splitlines()
    parts = [re.split(r" {2,}", line) for line in lines[2:]]
    assert max(map(len, lines)) <= 80
    assert lines[2].endswith("+10.23456 ± 0.12345")
    assert "".join(row[0] for row in parts) == name
    assert all(row[0].endswith(("_", ".", "alpha")) for row in parts)


@pytest.mark.parametrize(("value", "digits", "text"), [(-4e-5, 4, "0.0000"), (-6e-5, 4, "-0.0001"), (-0.0, 1, "0.0"), (12.345, 1, "12.3")])
def test_no_zero_is_below_zero(value: float, digits: int, text: str) -> None:
    """What is rounded to nothing has no sign, what is left keeps its own."""
    assert decimals(value, digits) == text
