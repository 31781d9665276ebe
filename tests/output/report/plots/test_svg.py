"""Pictures as parts of a page."""

from __future__ import annotations

import re

import numpy as np
import pytest
from lxml import etree

from urdfcal.output.report.plots.axes import Axes, Look
from urdfcal.output.report.plots.svg import WIDTH, Picture, draw_picture, look_of, shortened

WORDS = ("</text><script>", 'id="x" href="#y" url(#z)', "a\u00a0&amp; b")


def draw(axes: Axes) -> None:
    """A line that leaves the frame, with words as users may write them."""
    axes.points(np.array([0.0, 1.0, 2.0]), np.array([0.0, 30.0, 1.0]), Look("c0", "o", "solid"), WORDS[0])
    axes.y_ends = (0.0, 2.0)
    axes.x_label, axes.y_label = WORDS[1:]
    axes.name(WORDS[0], np.array([1.0, 1.0]))


@pytest.fixture(scope="module")
def picture() -> Picture:
    """One picture."""
    return draw_picture("spots", "Title <b>", 'Caption "x"', 150, draw)


def texts(picture: Picture) -> dict[str, etree._Element]:
    """Words in a picture, with their elements."""
    return {"".join(element.itertext()): element for element in etree.fromstring(picture.svg).iter("{*}text")}


def test_words_in_a_picture_stay_as_they_are(picture: Picture) -> None:
    """Also those that look like elements, ids or references; it says what it shows to those who do not see it."""
    assert set(WORDS) <= set(texts(picture))
    assert [key.label for key in picture.keys] == [WORDS[0]]
    assert str(etree.fromstring(picture.svg).get("aria-label")).startswith('Title <b>. Caption "x" a\u00a0&amp; b against id=')


def test_a_picture_has_no_colour_id_or_reference_of_its_own(picture: Picture) -> None:
    """Two pictures on one page cannot mix up their parts, and light and dark are the page's."""
    names = {name for element in etree.fromstring(picture.svg).iter() for name in element.attrib}
    assert not names & {"id", "href", "style", "clip-path"}
    assert not re.search(r"#[0-9a-f]{3,6}\\b", re.sub(r">[^<]*<", "><", picture.svg).replace("#y", "").replace("#z", ""))


def test_data_are_drawn_where_the_ticks_say(picture: Picture) -> None:
    """A mark at (2, 1) is as far right as the tick of 2 and as high as that of 1, within a frame that cuts off what lies outside."""
    root = etree.fromstring(picture.svg)
    ticks = {(str(each.get("text-anchor")), str(each.text)): each for each in root.iter("{*}text")}
    inside = list(root.iter("{*}svg"))[1]
    marks = next(str(path.get("d")) for path in inside.iter("{*}path") if path.get("stroke") == "none")
    x, y = map(float, re.findall(r"M([-\d.]+) ([-\d.]+)m", marks)[-1])
    assert float(inside.get("x")) + x == pytest.approx(float(ticks["middle", "2.0"].get("x")), abs=0.2)
    assert float(inside.get("y")) + y + 4 == pytest.approx(float(ticks["end", "1.0"].get("y")), abs=0.2)


@pytest.mark.parametrize("ends", [((0.0, 3000.0), (-100.0, 900.0)), ((-1.0, 1.0), (-1.0, 1.0))])
def test_equal_axes_have_equal_units(ends: tuple[tuple[float, float], tuple[float, float]]) -> None:
    """A map's frame is as high for its width as its window is."""

    def blank(axes: Axes) -> None:
        axes.x_ends, axes.y_ends = ends
        axes.equal = True

    root = etree.fromstring(draw_picture("maps", "Map", "", 0, blank).svg)
    inside = [each for each in root.iter("{*}svg")][1]
    assert float(inside.get("height")) / float(inside.get("width")) == pytest.approx(np.ptp(ends[1]) / np.ptp(ends[0]), rel=1e-4)


def test_all_pictures_are_equally_wide() -> None:
    """So letters are of one size throughout, also beside names of rows, which are shortened in their middle."""

    def rows(axes: Axes) -> None:
        axes.rows, axes.y_ends = ["left_arm_shoulder_pan_joint.d_theta", "a"], (-2.0, 1.0)

    picture = draw_picture("parameters", "Rows", "", 60, rows)
    assert f'viewBox="0 0 {WIDTH:g} ' in picture.svg
    (name,) = (word for word in texts(picture) if "…" in word)
    assert name == shortened("left_arm_shoulder_pan_joint.d_theta")
    assert name.startswith("left_arm_")
    assert name.endswith("joint.d_theta")


def test_sixty_four_frames_look_different() -> None:
    """Colour and mark together tell frames apart, and the first eight by their colour alone."""
    looks = [look_of(index) for index in range(64)]
    assert len(set(looks)) == 64
    assert len({colour for colour, _ in looks[:8]}) == len({mark for _, mark in looks[:8]}) == 8
