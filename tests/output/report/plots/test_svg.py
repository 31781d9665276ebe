"""Pictures as parts of a page."""

from __future__ import annotations

import re

import pytest
from lxml import etree
from matplotlib.axes import Axes

from urdfcal.output.report.plots.svg import INK, SERIES, Picture, draw_picture, house_style

WORDS = ("</text><script>", 'id="x" href="#y" url(#z)', "a\u00a0&amp; b", INK)


def draw(axes: Axes) -> None:
    """Points, a line that is cut at the frame, and words as users may write them."""
    axes.plot([0, 1, 2], [0, 3, 1], "o-", color=SERIES[0], label=WORDS[0])
    axes.set_ylim(0, 2)
    axes.set_title(WORDS[1])
    axes.set_xlabel(WORDS[2])
    axes.set_ylabel(WORDS[3])


@pytest.fixture(scope="module")
def picture() -> Picture:
    """One picture."""
    with house_style():
        return draw_picture("spots", "Title <b>", 'Caption "x"', 2.0, draw)


def test_words_in_a_picture_stay_as_they_are(picture: Picture) -> None:
    """Also those that look like ids, references or the stand-ins for colours."""
    root = etree.fromstring(picture.svg)
    found = [" ".join("".join(element.itertext()).split()) for element in root.iter("{*}text")]
    assert set(WORDS) <= {word.replace("a &", "a\u00a0&") for word in found}
    assert root.get("aria-label") == 'Title <b>. Caption "x"'


def test_ids_are_the_pictures_own_and_references_find_them(picture: Picture) -> None:
    """Two pictures on one page do not mix up their clips and markers."""
    ids = re.findall(r'\bid="([^"]*)"', re.sub(r">[^<]*<", "><", picture.svg))
    assert len(ids) == len(set(ids))
    assert all(name.startswith("title-b--") for name in ids)
    root = etree.fromstring(picture.svg)
    targets = {value[1:] for element in root.iter() for name, value in element.attrib.items() if name.endswith("href")}
    clips = {value[5:-1] for element in root.iter() if (value := element.get("clip-path"))}
    assert targets
    assert clips
    assert targets | clips <= set(ids)


def test_a_picture_says_nothing_of_its_maker(picture: Picture) -> None:
    """No metadata, no comments, no size of its own, no colour but the page's."""
    assert not re.search(r"<metadata|<!--|<!DOCTYPE|\bwidth=\"[\d.]+pt", picture.svg)
    assert not re.search(r"#[0-9a-f]{6}\b", re.sub(r">[^<]*<", "><", picture.svg))
    assert "var(--c0)" in picture.svg


@pytest.mark.parametrize(("label", "columns"), [("y", 4), ("forearm_link pixels", 2), ("a_link_with_quite_a_long_name orientation", 1)])
def test_legends_stay_inside_the_picture(label: str, columns: int) -> None:
    """Long names stand beside each other as far as there is room."""

    def lines(axes: Axes) -> None:
        for number in range(4):
            axes.plot([0, 1], [0, number], label=label if number else "a")

    with house_style():
        root = etree.fromstring(draw_picture("maps", "Title", "Caption", 2.0, lines).svg)
    found = [element for element in root.iter("{*}text") if "".join(element.itertext()) in (label, "a")]
    heights = [float((element.get("y") or element.get("transform", "").split()[1]).rstrip(")")) for element in found]
    assert len({round(height) for height in heights}) == -(-4 // columns)
