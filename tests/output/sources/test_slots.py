"""Places of numbers in sources, and what is written there."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from urdfcal.output.sources.slots import EXPRESSION, LITERAL, PART, decimal, edited, word_slots
from urdfcal.output.sources.xml_slots import XmlSource
from urdfcal.output.sources.yaml_slots import yaml_slots

HERE = Path("a.xacro")


@pytest.mark.parametrize("value", [0.0, -0.0, 1.0, -2.5, 1e-5, -1e-13, 1e-15, 123.456, 0.1 + 0.2])
def test_a_number_is_written_so_that_yaml_reads_a_number(value: float) -> None:
    """PyYAML takes `1e-05` for text; what is written is a float to it, the same to 1e-13."""
    read = yaml.safe_load(decimal(value))
    assert isinstance(read, float)
    assert abs(read - value) <= 0.5e-13


CORRECTED = {  # a word, its correction, and what becomes of it
    b"0.5": (0.25, b"0.75"),
    b"-1e-3": (0.002, b"0.001"),
    b"${0.5}": (0.25, b"${0.75}"),
    b"${ radians( 90 ) }": (0.5, b"${ radians( 90.5 ) }"),
    b"${math.pi*30/180}": (0.5, b"${math.pi*30.5/180}"),
    b"${-45 / 180.0 * pi}": (0.5, b"${-44.5 / 180.0 * pi}"),
    b"${a}": (0.25, b"${a + 0.25}"),
    b"${a - b}": (-0.25, b"${(a - b) - 0.25}"),
    b"-${a.b['c']}": (0.25, b"${-a.b['c'] + 0.25}"),
    b"${f(a) + (b)}": (0.25, b"${(f(a) + (b)) + 0.25}"),
    b"$(arg z)": (0.25, b"${$(arg z) + 0.25}"),
}


@pytest.mark.parametrize("word", CORRECTED)
def test_a_correction_is_written_in_the_words_own_manner(word: bytes) -> None:
    """A number stays a number in its unit; an expression gets the correction behind it, and is bracketed where it must be."""
    by, expected = CORRECTED[word]
    slots = list(word_slots(HERE, word, 0, len(word), b'"'))
    slot = min(slots, key=lambda each: each.kind)
    assert edited(word, slot.corrected(by)) == expected


def test_what_is_no_number_is_no_place() -> None:
    """Text, mixed words and indices are left alone; numbers of a list in an expression are places of its parts."""
    text = b"${prefix}joint_1 a0.5 0.${x} 1.2.3 ${table[2][0.5, 1]}"
    found = [(slot.text, slot.kind) for slot in word_slots(HERE, text, 0, len(text), b'"')]
    assert found == [(b"${table[2][0.5, 1]}", EXPRESSION), (b"1", PART)] or found[0][1] == EXPRESSION
    assert (b"2", PART) not in found


def test_elements_that_can_feed_an_origin_are_looked_at_alone() -> None:
    """Shapes, conditions and names have no places; properties, calls, defaults of parameters and origins do."""
    text = (
        b"""<robot xmlns:xacro="x"><xacro:property name="p" value="0.1"/><xacro:if value="1"><link name="2"><visual><origin xyz="3 3 3"/>"""
        b"""</visual></link></xacro:if><xacro:macro name="m" params="a:=4 b:='5 6' c:=^|7 *d e"><joint><origin xyz='8 9 10'/></joint>"""
        b"""</xacro:macro><xacro:m a="11"/><xacro:arg name="q" default="12"/></robot>"""
    )
    assert sorted(int(float(slot.text) * 10) // 10 for slot in XmlSource(HERE, text, 0).slots()) == [0, *range(4, 13)]


def test_scalars_of_yaml_are_found_by_their_bytes() -> None:
    """Names are none, rows of numbers are as many, text behind letters of several bytes is where it is, units' tags take expressions."""
    text = "é: {1: 2.5, b: !degrees 'x'}\nc: [ -3, '4' ]\nd: !degrees pi/2\ne: !other 7\nf: \"5 6\"  # 8\ng: |\n  9\n".encode()
    found = [(slot.text, slot.kind) for slot in yaml_slots(HERE, text)]
    assert found == [
        (b"2.5", LITERAL), (b"-3", LITERAL), (b"4", LITERAL), (b"pi/2", EXPRESSION), (b"5", LITERAL), (b"6", LITERAL)
    ]  # fmt: skip
    assert all(text[slot.start : slot.end] == slot.text for slot in yaml_slots(HERE, text))
