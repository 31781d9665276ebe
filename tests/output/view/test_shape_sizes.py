"""Shapes whose numbers cannot be drawn are left out and said, and the page comes up."""

from __future__ import annotations

import json
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from tests.support.meshes import STL, showing
from tests.support.small_robot import URDF, robot_of
from urdfcal.base.errors import RobotError
from urdfcal.output.view.shapes import robot_shapes
from urdfcal.output.view.viewer import view_of
from urdfcal.robot.robot import Robot

PLAIN = '<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>'
WRONG = ["nan", "inf", "-inf", "1e400", "1e308", "1001", "-1", "0", "", "x", "1,5"]


def with_shapes(*shapes: str) -> Robot:
    """The small robot with these shapes on `upper`, and a plain one on its base."""
    upper = "".join(shape if shape.startswith("<visual") else f"<visual><geometry>{shape}</geometry></visual>" for shape in shapes)
    text = URDF.replace('<link name="upper"/>', f'<link name="upper">{upper}</link>')
    return robot_of(text.replace('<link name="base"/>', f'<link name="base">{PLAIN}</link>'))


def config_of(robot: Robot) -> dict[str, object]:
    """What the page's script reads first, by JSON's own rules."""
    found = re.search(r'id="urdfcal-config">(.*?)</script>', view_of(robot).html)
    assert found
    config = json.loads(found[1], parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert isinstance(config, dict)
    return config


@pytest.mark.parametrize("number", WRONG)
@pytest.mark.parametrize(
    "shape",
    [
        '<box size="0.1 {} 0.1"/>',
        '<cylinder radius="{}" length="0.1"/>',
        '<cylinder radius="0.1" length="{}"/>',
        '<capsule radius="0.1" length="{}"/>',
        '<sphere radius="{}"/>',
    ],
)
def test_sizes_that_cannot_be_drawn_leave_the_shape_out(shape: str, number: str) -> None:
    """One line names link, number and limit; the link is a simple shape, the rest is as it was."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        robot = with_shapes(shape.format(number))
        shapes = robot_shapes(robot)
        config_of(robot)
    assert shapes.simple == ("upper",)
    assert "base_0" in {each.name for each in shapes.model.geometryObjects}
    assert len(shapes.warnings) == 1
    assert re.search("1 shapes are left out, the first because link 'upper': its .* expected .* above 0 and below 1000", shapes.warnings[0])


@pytest.mark.parametrize("number", ["nan", "inf", "1e308", "-1e5", "x"])
@pytest.mark.parametrize("attribute", ["xyz", "rpy"])
def test_placements_that_cannot_be_drawn_leave_the_shape_out(attribute: str, number: str) -> None:
    """A shape that is nowhere would take the camera with it."""
    origin = f'<origin {attribute}="0 {number} 0"/>'
    robot = with_shapes(PLAIN.replace("<geometry>", f"{origin}<geometry>"))
    assert re.search(f"its origin {attribute} is '0 {re.escape(number)} 0'", *robot_shapes(robot).warnings)
    config_of(robot)


@pytest.mark.parametrize("number", ["nan", "inf", "1e308", "0", "x"])
def test_scales_that_cannot_be_drawn_leave_the_mesh_out(tmp_path: Path, number: str) -> None:
    """A mirrored one is fine, one of no size is not; so is a scale that makes a mesh larger than a kilometre."""
    (tmp_path / "a.stl").write_text(STL)
    assert robot_shapes(showing("a.stl", tmp_path, 'scale="1 -1 0.001"')).warnings == ()
    assert "its mesh scale is" in robot_shapes(showing("a.stl", tmp_path, f'scale="1 {number} 1"')).warnings[0]
    (tmp_path / "a.stl").write_text(STL.replace("vertex 1", "vertex 2"))
    assert "beyond 1000 m" in robot_shapes(showing("a.stl", tmp_path, 'scale="600 1 1"')).warnings[0]


def test_many_of_a_kind_are_one_line() -> None:
    """With their number and the first of them."""
    said = robot_shapes(with_shapes(*[f'<sphere radius="-{k}"/>' for k in range(1, 6)])).warnings
    assert len(said) == 1
    assert said[0].startswith("5 shapes are left out, the first because link 'upper': its sphere radius is '-1', expected 1 number above 0")


@pytest.mark.parametrize("rgba", ["nan 0 0 1", "1 0 0", "255 0 0 1", "1e999 0 0 1", "red"])
def test_colours_that_are_none_are_grey(rgba: str) -> None:
    """The shape is drawn all the same, which a viewer that meets such a colour would not."""
    material = f'<material name="m"><color rgba="{rgba}"/></material>'
    shapes = robot_shapes(with_shapes(PLAIN.replace("</visual>", f"{material}</visual>")))
    assert shapes.warnings == ("1 colours are drawn grey: an rgba is four numbers from 0 to 1",)
    drawn = shapes.model.geometryObjects[shapes.model.getGeometryId("upper_0")]
    np.testing.assert_allclose(drawn.meshColor, (0.5, 0.5, 0.5, 1.0))


@pytest.mark.parametrize("length", ["2e5", "1e6"])
def test_a_robot_larger_than_any_is_refused_in_one_line(length: str) -> None:
    """Its page would be empty."""
    text = URDF.replace('xyz="0.3 0 0"', f'xyz="{length} 0 0"')
    assert text != URDF
    view = view_of(robot_of(text))
    with pytest.raises(RobotError, match="the robot reaches beyond 100 km"):
        _ = view.html


def test_a_material_that_is_a_texture_alone_is_not_black() -> None:
    """The shape has its own colour then: a primitive the usual grey, whether the material is its own or the robot's."""
    own = '<material name="m"><texture filename="x.png"/></material>'
    robot = with_shapes(PLAIN.replace("</visual>", f"{own}</visual>"))
    shapes = robot_shapes(robot)
    drawn = shapes.model.geometryObjects[shapes.model.getGeometryId("upper_0")]
    np.testing.assert_allclose(drawn.meshColor, (0.9, 0.9, 0.9, 1.0))
    assert not drawn.overrideMaterial
