"""Options of `fit` as a fleet has them: some are its own, and what else they write goes into the robot's folder."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

_ITS_OWN = {
    "-o": "each robot's results go into its folder",
    "--output": "each robot's results go into its folder",
    "--json": "the summary has what it says",
    "-q": "say it to fleet",
    "--quiet": "say it to fleet",
    "-v": "fit one robot alone to be told more",
    "--verbose": "fit one robot alone to be told more",
    "--help": "see urdfcal fit --help",
    "--in-place": "robots of one model share its sources; --xacro-folder writes copies, each into its robot's folder",
}
_PLACES = ("--report", "--compensation", "--xacro-folder")


def unsuitable(words: Sequence[str]) -> str:
    """Which option cannot be one of a robot's, and why; empty where all can."""
    for word in words:
        for option in (_short(word), word.partition("=")[0]):
            if option in _ITS_OWN:
                return f"{option} cannot be among the options of fit here: {_ITS_OWN[option]}"
    return ""


def placed(words: Sequence[str], folder: Path) -> Iterator[str]:
    """The same words, places that they name being in a folder."""
    place = False
    for word in words:
        option, stated, value = word.partition("=")
        if place:
            yield str(folder / word)
        elif option in _PLACES and stated:
            yield f"{option}={folder / value}"
        else:
            yield word
        place = word in _PLACES and not place


def named(words: Sequence[str]) -> Iterator[str]:
    """What may be files among them."""
    yield from (word.partition("=")[2] if word.startswith("--") else word for word in words)


def _short(word: str) -> str:
    """`-o` of `-oFILE`."""
    return word[:2] if word.startswith("-") and not word.startswith("--") and word[1:2].isalpha() else word
