# ruff: noqa: E501
"""Numbers and lines as people read them."""

from __future__ import annotations

import pytest

from urdfcal.base.terminal import as_text, figures_table, rounded, value_and_sigma


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
