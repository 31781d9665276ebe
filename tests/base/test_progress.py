"""Counting: who listens hears what is done and how often, everybody else nothing."""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Callable

import pytest

from urdfcal.base.progress import counted, each, listening
from urdfcal.cli.console import Working, say


class Heard:
    """Writes down what it hears."""

    def __init__(self) -> None:
        self.words: list[str] = []

    def begin(self, what: str, total: int | None) -> Callable[[], None]:
        self.words.append(f"{what} of {total}")
        return lambda: self.words.append(what)

    def end(self, advance: Callable[[], None]) -> None:
        self.words.append("end")


def test_what_is_counted_is_heard_inside_alone() -> None:
    """A listener hears beginnings, steps and ends, also of what is broken off; before and after it nothing is told."""
    heard = Heard()
    assert list(each("ab", "letter", 2)) == ["a", "b"]
    with listening(heard):
        for letter in each("abc", "letter", 3):
            if letter == "b":
                break
        with contextlib.suppress(ZeroDivisionError), counted("pose") as advance:
            advance()
            _ = 1 / 0
    with counted("pose") as advance:
        advance()
    assert heard.words == ["letter of 3", "letter", "end", "pose of None", "pose", "end"]


class Terminal(io.StringIO):
    """A stream that somebody looks at."""

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("looked_at", [True, False], ids=["terminal", "piped"])
def test_a_terminal_shows_counts_and_the_time_to_go(looked_at: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where somebody looks, lines say how many of how many, and how long that takes; a pipe gets nothing."""
    stream = Terminal() if looked_at else io.StringIO()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    working = Working("fitting", False)
    with working, counted("generation", 60) as advance:
        advance()
        advance()
        if looked_at:
            working.bar.refresh()
    shown = stream.getvalue()
    assert all((words in shown) == looked_at for words in ("fitting", "generation", "2 of 60", "a minute", " left"))


def test_a_sentence_is_broken_between_words_on_a_terminal_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Warnings fit the terminal; in a file each is a line."""
    monkeypatch.setenv("COLUMNS", "40")
    sentence, looked_at, piped = "word " * 20 + "end", Terminal(), io.StringIO()
    say(True, sentence, looked_at)
    say(True, sentence, piped)
    assert piped.getvalue() == f"{sentence}\n"
    assert max(map(len, looked_at.getvalue().splitlines())) <= 40
    assert looked_at.getvalue().split() == sentence.split()
