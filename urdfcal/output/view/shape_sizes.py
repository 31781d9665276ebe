"""Whether what a URDF says of a shape can be drawn: sizes above zero, nothing beyond what any robot has."""

from __future__ import annotations

from collections.abc import Iterator

from lxml import etree

from urdfcal.robot.urdf_xml import finite_number

LARGEST = 1000.0  # [m] of a shape, and of its distance from its link
_GREY = "0.5 0.5 0.5 1"
_SIZES = {
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
}


def size_fault(visual: etree._Element) -> str | None:
    """What of a <visual>'s numbers cannot be drawn, as a name, what was found and what was expected; None where all can."""
    return next(_faults(visual), None)


def _faults(visual: etree._Element) -> Iterator[str]:
    for origin in visual.findall("origin"):
        yield from _fault("origin xyz", origin.get("xyz"), 3, -LARGEST)
        yield from _fault("origin rpy", origin.get("rpy"), 3, -LARGEST)
    for kind, expected in _SIZES.items():
        for shape in visual.iterfind(f"geometry/{kind}"):
            for name, count in expected.items():
                yield from _fault(f"{kind} {name}", shape.get(name, ""), count, 0.0)
    for mesh in visual.iterfind("geometry/mesh"):
        yield from _fault("mesh scale", mesh.get("scale"), 3, -LARGEST, zero=False)


def _fault(what: str, text: str | None, count: int, above: float, zero: bool = True) -> Iterator[str]:
    """A fault of one attribute, if it is there and has one.

    Args:
        what: Its name.
        text: Its numbers; None if there are none.
        count: How many there must be.
        above: They must be larger than this.
        zero: Whether zero is a value, if it is larger than that.
    """
    if text is None:
        return
    numbers = [finite_number(word) for word in text.split()]
    if len(numbers) != count or any(each is None or not above < each < LARGEST or (each == 0 and not zero) for each in numbers):
        least = "above 0" if above == 0 else f"above {above:g}" if zero else f"above {above:g}, not 0"
        yield f"its {what} is '{text}', expected {count} {'number' if count == 1 else 'numbers'} {least} and below {LARGEST:g}"


def grey_where_no_colour(root: etree._Element) -> int:
    """Give materials whose rgba is not four numbers from 0 to 1 a grey; how many there were."""
    wrong = [colour for colour in root.iter("color") if not _is_colour(colour.get("rgba", ""))]
    for colour in wrong:
        colour.set("rgba", _GREY)
    return len(wrong)


def pass_over_textures(root: etree._Element) -> None:
    """Take out materials that are a texture alone, which would be drawn black; what they belong to is drawn in its own colours."""
    for material in [each for each in root.iter("material") if each.find("texture") is not None and each.find("color") is None]:
        parent = material.getparent()
        if parent is not None:
            parent.remove(material)


def _is_colour(text: str) -> bool:
    numbers = [finite_number(word) for word in text.split()]
    return len(numbers) == 4 and all(each is not None and 0 <= each <= 1 for each in numbers)
