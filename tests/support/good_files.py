"""A file of every kind that urdfcal reads, small, and the commands that take each; what `tests/cli/test_mutations.py` breaks."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from tests.conftest import CliResult
from tests.output.test_formats import UR_ORIGINS, ur_text
from tests.support.meshes import OBJ, STL, TRIANGLE, collada
from tests.support.other_models import MJCF, SDF
from tests.support.small_robot import URDF, XACRO
from urdfcal.output.driver_yaml import ur_yaml
from urdfcal.robot.robot import load_robot

RIG = """\
screen: screen
error_models: {lift: placement}
noise: {spot_mm: 0.5, joint_deg: 0.01}
priors: {joint: '1mm,0.1deg', mount: '20mm,2deg', screen: '50mm,2deg'}
parameters:
  lift.rot_x: {sigma_deg: 0.1}
  slm.trans_x: {value_mm: 2.5, sigma_mm: 0.2}
  slide.*: {fixed: true}
"""
ERRORS = "error_model: placement\nparameters: {lift.trans_x: 0.002, turn.rot_y: 0.003, slide.trans_y: -1e-3}\n"
LIMITS = "deg: {turn: [-20, 30]}\nrad: {lift: [-0.4, 0.5]}\nmm: {slide: [10, 250.0]}\n"
SCENE = (
    "link: base\nboxes: {table: {size_mm: [300, 300, 40], xyz_mm: [0, 0, -900]}}\n"
    "planes: {floor: {normal: [0, 0, 1], xyz_mm: [0, 0, -950]}}\n"
    "cylinders: {post: {radius_mm: 40, length_mm: 90, xyz_mm: [0, -2000, 450], rpy_deg: [0, 0, 10]}}\n"
    "meshes: {part: {file: part.stl, scale: 0.001, xyz_mm: [0, 3000, 0]}}\n"
)
SRDF = '<robot name="small"><disable_collisions link1="base" link2="upper" reason="Adjacent"/></robot>\n'
INFO = (
    "image_width: 280\nimage_height: 210\ncamera_matrix:\n  rows: 3\n  cols: 3\n  data: [262.0, 0, 140, 0, 262.0, 105, 0, 0, 1]\n"
    "distortion_model: plumb_bob\ndistortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.1, 0.01, 1e-3, -1e-3, 0]\n"
    "screen: {side: front, xyz: [0.1, 0.2, 2.5], rpy: [1.5, 0.1, -1.6]}\n"
)
MARKERS = "dictionary: DICT_4X4_50\nsize_mm: 250\nmarkers: {0: [550, 400], 1: [-550, 400], 2: [550, -400], 3: [-550, -400]}\n"
BENCH = "distance [mm],laser_1.x [mm],laser_1.y [mm],laser_2.x [mm],laser_2.y [mm]\n" + "".join(
    f"{distance},{0.2 * distance + 1},{0.3 + 0.01 * distance},{-0.2 * distance},{0.1 + 0.02 * distance}\n"
    for distance in range(100, 1000, 100)
)
MTL = "newmtl grey\nKd 0.5 0.5 0.5\n"
SHOWN = "".join(f'<visual><geometry><mesh filename="part.{ending}"/></geometry></visual>' for ending in ("stl", "obj", "dae"))
UR = f'<robot name="ur"><link name="base_link"/>{ur_text("")}</robot>'
TARGETS = "turn,lift,slide [mm],note\n0.1,0.2,100,a\n-0.3,0.1,50,b\n"
DH = "joint,d_a [mm],d_alpha,d_theta [deg]\nturn,0.5,1e-3,0.02\nlift,-0.1,2e-3,0.1\n"
TESSERACT = "calibration: {joints: {lift: {position: {x: 0.301, y: 0, z: 0}, orientation: {r: 0.1, p: 0, y: 0}}}}\n"
SCRIPT = "def p():\n  q = [0.1, 0.2, 0.05]\n  movej(q)\n  movej([-0.2,0.3,0.1], a=1)\nend\n"
KRL = "PTP {A1 10.0,A2 5,A3 0.5}\nDECL E6AXIS XP1={A1 -3.0,A2 2.0,A3 0.25}\n"
FLEET = "name,description,measurements,options\na,small.urdf,points.csv,--no-sag\nb,small.urdf,m.csv,--no-sag --error-model dh\n"
TEXTS = {
    "small.urdf": URDF,
    "targets.csv": TARGETS,
    "dh.csv": DH,
    "prior.yaml": "urdfcal: prior\nrobots: 5\njoint: {translation_mm: 1.5, rotation_deg: 0.1, zero_deg: 0.2}\n",
    "fleet.csv": FLEET,
    "p.script": SCRIPT,
    "p.src": KRL,
    "model.xml": MJCF,
    "tesseract.yaml": TESSERACT,
    "model.sdf": SDF,
    "small.xacro": XACRO,
    "shown.urdf": URDF.replace('<link name="upper"/>', f'<link name="upper">{SHOWN}</link>'),
    "ur.urdf": UR,
    "rig.yaml": RIG,
    "limits.yaml": LIMITS,
    "limits.csv": "joint,lower,upper,unit\nturn,-20,0.3e2,deg\nslide,0.01,0.2,m\n",
    "scene.yaml": SCENE,
    "small.srdf": SRDF,
    "info.yaml": INFO,
    "errors.yaml": ERRORS,
    "markers.yaml": MARKERS,
    "bench.csv": BENCH,
    "part.stl": STL,
    "part.obj": f"mtllib part.mtl\nusemtl grey\n{OBJ}",
    "part.mtl": MTL,
    "part.dae": collada(f"<node>{TRIANGLE}</node>", textures=("part.png",)),
}
SENSORS = {"points.csv": "point:tool", "pose.csv": "pose:tool", "length.csv": "distance:tool", "level.csv": "inclination:tool"}
SENSORS |= {"plane.csv": "plane:tool", "socket.csv": "socket:tool"}
ENDINGS = ("png", "jpg", "tif", "bmp", "webp", "ppm")
VIEWS = ("view1.png", "view2.png", "view3.png")
_VIEW = "view shown.urdf --html out.html --overwrite"
_LENS = f"camera {' '.join(VIEWS)} --board 4x3:30mm -o out.yaml --overwrite --distortion plain"
_SCREEN = "camera --lens camera.yaml --screen marked.png --markers markers.yaml -o out.yaml --overwrite"
_POSES = "poses small.urdf -o out.csv --overwrite --sensor point:tool --candidates 10 -n 3"
_PIXELS = "fit small.urdf pixels.csv --camera camera.yaml -o out.urdf --overwrite"
COMMANDS = {
    "small.urdf": (
        "fit small.urdf m.csv -o out.urdf --overwrite",
        "check small.urdf m.csv",
        "dh small.urdf",
        "view small.urdf m.csv --html out.html --overwrite",
        "paper small.urdf --runs 1",
        "simulate small.urdf -o out.csv --overwrite --poses 3 --sag-mrad 1",
        "simulate small.urdf -o out --poses 3 --robots 2",
    ),
    "c.urdf": (
        "import small.urdf c.urdf -o out.yaml --overwrite",
        "compare small.urdf c.urdf --json",
        "rig c.urdf --tip tool --tracker --prefix two_ -o out.urdf --overwrite",
    ),
    "small.xacro": (
        "fit small.xacro m.csv -o out.urdf --format urdf --format xacro --split --overwrite --xacro-arg height:=0.2",
        "dh small.xacro",
    ),
    "m.csv": (
        "fit small.urdf m.csv -o out.urdf --overwrite",
        "evaluate small.urdf m.csv",
        "check small.urdf m.csv --json",
        "measurements small.urdf m.csv",
        "fit small.urdf m.csv -o out.urdf --overwrite --compensation out_sag.yaml",
        "fit small.urdf m.csv -o out.urdf --overwrite --report out.html --report out.md --report out.json",
        "fit small.urdf one.csv --test m.csv -o out.urdf --overwrite --json",
    ),
    "pixels.csv": (
        _PIXELS,
        "evaluate small.urdf pixels.csv --camera camera.yaml",
        "measurements small.urdf pixels.csv --camera camera.yaml",
    ),
    "rig.yaml": ("fit small.urdf m.csv -o out.urdf --overwrite --rig rig.yaml", "check small.urdf m.csv --rig rig.yaml"),
    "c.yaml": (
        "apply small.urdf c.yaml -o out.urdf --overwrite",
        "apply small.urdf c.yaml -o out.yaml --format origins-yaml --overwrite",
        "dh small.urdf --calibration c.yaml",
        "view small.urdf --calibrated c.yaml --html out.html --overwrite",
        "fit c.urdf m.csv --after c.yaml -o out.urdf --overwrite",
        "compare c.yaml small.urdf",
        "correct small.urdf targets.csv --calibration c.yaml -o out.csv --overwrite --tool tool",
    ),
    "limits.yaml": (f"{_POSES} --limits limits.yaml --no-collisions",),
    "limits.csv": (f"{_POSES} --limits limits.csv --no-collisions",),
    "scene.yaml": (f"{_POSES} --scene scene.yaml",),
    "small.srdf": (f"{_POSES} --srdf small.srdf",),
    "poses.csv": (
        "view small.urdf poses.csv --html out.html --overwrite",
        f"{_POSES} --region poses.csv --no-collisions",
    ),
    "info.yaml": ("measurements small.urdf pixels.csv --camera info.yaml",),
    "prior.yaml": ("fit small.urdf m.csv -o out.urdf --overwrite --prior-from prior.yaml",),
    "tesseract.yaml": ("import small.urdf tesseract.yaml -o out.yaml --overwrite",),
    "dh.csv": ("import small.urdf dh.csv --convention modified --tip tool -o out.yaml --overwrite",),
    **{
        name: (f"correct small.urdf {name} --calibration c.yaml -o out.{name.rpartition('.')[2]} --overwrite --tool tool",)
        for name in ("targets.csv", "p.script", "p.src")
    },
    **{name: (f"apply small.urdf c.yaml --onto {name} -o out.{name[-3:]} --overwrite --json",) for name in ("model.xml", "model.sdf")},
    "ur.yaml": ("apply ur.urdf urc.yaml --format ur --ur-hash-from ur.yaml -o out.yaml --overwrite",),
    "errors.yaml": ("simulate small.urdf -o out.csv --overwrite --poses 5 --errors errors.yaml",),
    "camera.yaml": (
        "render small.urdf one.csv --camera camera.yaml -o out --overwrite",
        "spots p.png --camera camera.yaml -o out.csv --overwrite --robot small.urdf",
        _PIXELS,
        _SCREEN,
    ),
    "one.csv": (
        "render small.urdf one.csv --camera camera.yaml -o out --overwrite",
        "spots p.png --poses one.csv --robot small.urdf --camera camera.yaml -o out.csv --overwrite",
    ),
    **{f"p.{ending}": (f"spots p.{ending} --pixels -o out.csv --overwrite",) for ending in ENDINGS},
    "dark.png": ("spots p.png --pixels --dark dark.png -o out.csv --overwrite",),
    "marked.png": (_SCREEN,),
    VIEWS[0]: (_LENS,),
    "bench.csv": ("module bench.csv -o out.yaml --overwrite",),
    "markers.yaml": ("markers markers.yaml -o out.pdf --paper full --overwrite", _SCREEN),
    "shown.urdf": (_VIEW,),
    **{name: (_VIEW,) for name in ("part.stl", "part.obj", "part.mtl", "part.dae", "part.png")},
    **{name: (f"fit small.urdf {name} -o out.urdf --overwrite", f"evaluate small.urdf {name}") for name in SENSORS},
    "fleet.csv": ("fleet fleet.csv -o out --workers 1",),
    "framed.yaml": (
        "apply small.urdf framed.yaml -o out.urdf --overwrite --add-frames --frame screen=tracker --frame tool",
        "apply small.urdf framed.yaml -o out.urdf --overwrite",
    ),
}
BESIDE = ("ur.urdf", "urc.yaml", "sag.yaml", "sag.urdf", *VIEWS[1:])  # what commands take beside the file that is broken
FIT = {"out.urdf", "out_calibration.yaml"}
Run = Callable[..., CliResult]


@dataclass
class Good:
    """Files that are taken as they are, and what each command leaves of them."""

    files: dict[str, bytes] = field(default_factory=dict)
    outputs: dict[str, set[str]] = field(default_factory=dict)


def make(run_cli: Run, folder: Path) -> Good:
    """Files of every kind, each taken by its commands."""
    for name, text in TEXTS.items():
        (folder / name).write_text(text)
    _measure(run_cli, folder)
    _paint(folder)
    (folder / "ur.yaml").write_bytes(_ur_kinematics(folder))
    (folder / "camera.yaml").write_bytes((folder / "pictures" / "camera.yaml").read_bytes())
    for name in ("c", "f"):
        stored = (folder / f"{name}_calibration.yaml").read_text()  # no time in it: every mutation can be repeated
        to = {"c": "c.yaml", "f": "framed.yaml"}[name]
        (folder / to).write_text(re.sub("created: .*", "created: '2026-11-22T00:00:00+00:00'", stored))
    good = Good({name: (folder / name).read_bytes() for name in (*COMMANDS, *BESIDE)})
    sweep(folder, set(good.files))
    for command in dict.fromkeys(command for commands in COMMANDS.values() for command in commands):
        run = run_cli(*command.split())
        assert run.code == 0 or (command.startswith("fit") and run.code == 3), (command, run)  # some sensors see too little
        good.outputs[command] = sweep(folder, set(good.files)) or (FIT if command.startswith("fit") else set())
    return good


def sweep(folder: Path, kept: set[str]) -> set[str]:
    """Remove what else is in a folder; its names."""
    left = set(os.listdir(folder)) - kept
    for name in left:
        path = folder / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    return left


def _measure(run_cli: Run, folder: Path) -> None:
    for command in (
        "simulate small.urdf -o m.csv --poses 20 --errors 5mm,0.5deg --spot-noise-mm 0.3",
        "simulate small.urdf -o one.csv --poses 1",
        "poses small.urdf -o poses.csv --sensor point:tool --candidates 12 -n 4 --no-collisions --approach both",
        "fit small.urdf m.csv -o c.urdf --error-model placement",
        "fit small.urdf m.csv -o g.urdf --compensation sag.yaml",
        "render small.urdf one.csv -o pictures --spot-mm 30 --markers markers.yaml --dark dark.png",
        "render small.urdf m.csv -o series --camera pictures/camera.yaml",
        "simulate ur.urdf -o ur.csv --poses 5 --sensor pose:link6",
        *(f"simulate small.urdf -o {name} --poses 15 --errors 10mm,1deg --sensor {sensor}" for name, sensor in SENSORS.items()),
        "fit small.urdf pose.csv -o f.urdf --force",
    ):
        assert (run := run_cli(*command.split())).code == 0, (command, run)
    one = folder / "one.csv"
    one.write_text(re.sub(r"(?m)^(pose|1),", "", one.read_text()))  # no label: its one row is that of any picture
    (folder / "ur_truth.yaml").rename(folder / "urc.yaml")
    (folder / "pixels.csv").write_text(_in_pixels((folder / "m.csv").read_text(), (folder / "series" / "truth.csv").read_text()))


def _in_pixels(measured: str, truth: str) -> str:
    """The joints of measurements with their spots in pixels."""
    rows = [[line.split(",") for line in text.splitlines() if not line.startswith("#")] for text in (measured, truth)]
    kept = [
        [index for index, name in enumerate(table[0]) if name in {"turn", "lift", "slide"} or name.endswith((".u", ".v"))] for table in rows
    ]
    return "".join(
        ",".join(row[index] for row, own in zip(pair, kept, strict=True) for index in own) + "\n" for pair in zip(*rows, strict=True)
    )


def _ur_kinematics(folder: Path) -> bytes:
    robot = load_robot(folder / "ur.urdf")
    return ur_yaml(robot, {name: robot.tree.joints[name].origin for name in UR_ORIGINS}, "calib_1")


def _paint(folder: Path) -> None:
    picture = cv2.imread(str(folder / "pictures" / "1.png"))
    for ending in ENDINGS:  # the others need no camera: a part will do
        cv2.imwrite(str(folder / f"p.{ending}"), picture if ending == "png" else picture[70:140, 100:180])
    cv2.imwrite(str(folder / "marked.png"), picture)
    cv2.imwrite(str(folder / "part.png"), np.full((4, 4, 3), 90, np.uint8))
    for name, tilt in zip(VIEWS, (-20, 0, 25), strict=True):
        cv2.imwrite(str(folder / name), _board(tilt))


def _board(tilt: float) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """A chessboard of 5 x 4 squares seen from one side or the other."""
    flat = np.kron(np.indices((4, 5)).sum(axis=0) % 2, np.ones((20, 20))).astype(np.uint8) * 200 + 30
    flat = cv2.copyMakeBorder(flat, 20, 20, 20, 20, cv2.BORDER_CONSTANT, value=230)
    corners = np.array([[0, 0], [140, 0], [140, 120], [0, 120]], np.float32)
    seen = corners + np.array([[30, 20], [10, 20 + tilt], [10, 10 - tilt], [30 + tilt / 2, 10]], np.float32)
    return np.asarray(cv2.warpPerspective(flat, cv2.getPerspectiveTransform(corners, seen), (200, 150), borderValue=230))
