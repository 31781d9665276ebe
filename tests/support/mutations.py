"""Ways to break a file at random: bytes, lines, words, numbers."""

from __future__ import annotations

import re

import numpy as np

ODD = [
    b"\x00",
    b"\xff",
    b"<",
    b">",
    b"&",
    b'"',
    b"'",
    b"-",
    b"e9",
    b"nan",
    b"{",
    b"[",
    b"*",
    b": ",
    b",",
    b";",
    b"\t",
    b"\n",
    b"\r",
    b"#",
    b"${",
    b"9" * 40,
    "\u00e4".encode(),
]


def flip(text: bytes, rng: np.random.Generator) -> bytes:
    place = int(rng.integers(len(text)))
    return text[:place] + bytes([text[place] ^ (1 << int(rng.integers(8)))]) + text[place + 1 :]


def put_in(text: bytes, rng: np.random.Generator) -> bytes:
    place = int(rng.integers(len(text) + 1))
    return text[:place] + ODD[int(rng.integers(len(ODD)))] + text[place:]


def take_out(text: bytes, rng: np.random.Generator) -> bytes:
    place = int(rng.integers(len(text)))
    return text[:place] + text[place + int(rng.integers(1, 12)) :]


def cut(text: bytes, rng: np.random.Generator) -> bytes:
    return text[: int(rng.integers(len(text)))]


def change_line(text: bytes, rng: np.random.Generator) -> bytes:
    """Double, drop or move a line."""
    lines = text.splitlines(keepends=True)
    one, other = (int(index) for index in rng.integers(len(lines), size=2))
    kind = int(rng.integers(3))
    if kind == 0:
        lines.insert(one, lines[other])
    elif kind == 1:
        del lines[one]
    else:
        lines[one], lines[other] = lines[other], lines[one]
    return b"".join(lines)


def swap_words(text: bytes, rng: np.random.Generator) -> bytes:
    """Swap two numbers or names: cells of a CSV, values of attributes, entries of YAML."""
    words = list(re.finditer(rb"[\w.+-]+", text))
    if not words:
        return text
    first, second = sorted((words[int(index)] for index in rng.integers(len(words), size=2)), key=lambda word: word.start())
    if first.end() > second.start():
        return text
    return text[: first.start()] + second[0] + text[first.end() : second.start()] + first[0] + text[second.end() :]


def change_number(text: bytes, rng: np.random.Generator) -> bytes:
    """Put another number, some of them absurd, where one stands."""
    numbers = list(re.finditer(rb"[-+]?\d+(\.\d*)?(e[-+]?\d+)?", text))
    if not numbers:
        return text
    place = numbers[int(rng.integers(len(numbers)))]
    value = rng.choice([b"0", b"-1", b"3.2", b"1e-300", b"1e300", b"-7e8", b"90", b"1e999", b"0.01"])
    return text[: place.start()] + bytes(value) + text[place.end() :]


MUTATIONS = [flip, put_in, take_out, cut, change_line, swap_words, change_number, change_number]


def broken(content: bytes, rng: np.random.Generator) -> bytes:
    """A file broken in one to three ways; never an empty one."""
    for _ in range(int(rng.choice([1, 1, 2, 3]))):
        content = MUTATIONS[int(rng.integers(len(MUTATIONS)))](content, rng) or b"a 1\n"
    return content
