"""Small meshes, and descriptions that show them."""

from __future__ import annotations

from pathlib import Path

from tests.support.small_robot import URDF, robot_of
from urdfcal.robot.robot import Robot

STL = "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid s\n"
OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
_GEOMETRY = (
    '<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="pa" count="9">0 0 0 1 0 0 0 1 0</float_array>'
    '<technique_common><accessor source="#pa" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>'
    '<param name="Z" type="float"/></accessor></technique_common></source><vertices id="v"><input semantic="POSITION" source="#p"/>'
    '</vertices><triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles></mesh></geometry>'
    "</library_geometries>"
)
TRIANGLE = '<instance_geometry url="#g"/>'


def collada(nodes: str = f"<node>{TRIANGLE}</node>", libraries: str = "", textures: tuple[str, ...] = ()) -> str:
    """A Collada file of one triangle, with pictures and whatever else."""
    images = "".join(f'<image id="i{index}"><init_from>{name}</init_from></image>' for index, name in enumerate(textures))
    libraries += f"<library_images>{images}</library_images>" if textures else ""
    return (
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset/>'
        f'{libraries}{_GEOMETRY}<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>'
        '<scene><instance_visual_scene url="#s"/></scene></COLLADA>'
    )


def showing(mesh: str, folder: Path, attributes: str = "") -> Robot:
    """The small robot, described in a folder, whose link `upper` is this mesh."""
    visual = f'<visual><geometry><mesh filename="{mesh}" {attributes}/></geometry></visual>'
    return robot_of(URDF.replace('<link name="upper"/>', f'<link name="upper">{visual}</link>'), str(folder / "small.urdf"))
