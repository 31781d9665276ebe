"""Arguments and options that several commands share."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from urdfcal.cli.help import EXPERT

RIG, DESCRIPTION, OUTPUT = "What measures", "Robot description", "Output"  # groups of options; the usual one comes before, EXPERT last


class ErrorModelName(StrEnum):
    """The error models, as `model.slots.MODELS` has them."""

    AUTO = "auto"
    DH = "dh"
    HAYATI = "hayati"
    PLACEMENT = "placement"
    OFFSET = "offset"


class EstimatorName(StrEnum):
    """The estimators, as `estimation.estimators.ESTIMATORS` has them."""

    EKF = "ekf"
    LSE = "lse"
    ROBUST = "robust"
    EVOLUTION = "evolution"


class Schedule(StrEnum):
    """The EKF's schedules, as `estimation.estimators.SCHEDULES` has them."""

    ITERATED = "iterated"
    PAPER = "paper"


class PriorScales(StrEnum):
    """Who chooses the joints' prior scales."""

    AUTO = "auto"
    STATED = "stated"


class FormatName(StrEnum):
    """The formats, as `output.formats.ENDINGS` has them."""

    URDF = "urdf"
    ORIGINS_YAML = "origins-yaml"
    UR = "ur"
    OFFSETS = "offsets"
    RISING = "rising"
    ROS2_CONTROL = "ros2-control"
    XARM = "xarm"
    FRANKA = "franka"
    FLEXIV = "flexiv"
    TESSERACT = "tesseract"
    XACRO = "xacro"


class Addition(StrEnum):
    """What can be estimated beside the joints, as `model.options.ADDITIONS` has it."""

    SCREEN = "screen"
    BEAMS = "beams"
    BEAMS4 = "beams4"
    LENS = "lens"


class Beside(StrEnum):
    """What can be tried beside sag, as `model.softness.EXTRAS` has it."""

    SCALE = "scale"
    ECCENTRICITY = "eccentricity"
    APPROACH = "approach"


class NoiseShape(StrEnum):
    """How simulated noise is distributed."""

    GAUSSIAN = "gaussian"
    UNIFORM = "uniform"


def chosen(options: Iterable[StrEnum] | None) -> tuple[str, ...]:
    """Choices as the words that they are."""
    return tuple(option.value for option in options or ())


RobotFile = Annotated[Path, typer.Argument(metavar="ROBOT", help="URDF or xacro file. A xacro file is code: it runs.", show_default=False)]
DataFile = Annotated[
    Path,
    typer.Argument(
        metavar="MEASUREMENTS", help="CSV: a column a joint, and what was measured: <laser>.y .z, <link>.x .y .z ...", show_default=False
    ),
]
XacroArgs = Annotated[
    list[str] | None,
    typer.Option(
        "--xacro-arg", metavar="NAME:=VALUE", help="Value of a xacro argument; repeatable.", show_default=False, rich_help_panel=DESCRIPTION
    ),
]
XacroLimits = Annotated[
    str | None,
    typer.Option(
        "--xacro-limit",
        metavar="60s,4GB",
        help="Time and memory that the expansion of a xacro file may take. Default: 60s,4GB.",
        show_default=False,
    ),
]
PackageDirs = Annotated[
    list[Path] | None,
    typer.Option(
        "--package-dir",
        metavar="DIR",
        help="Folder in which packages are looked for first; repeatable.",
        show_default=False,
        rich_help_panel=DESCRIPTION,
    ),
]
Screen = Annotated[
    str | None,
    typer.Option(
        metavar="LINK",
        help="Screen link; its plane x = 0 is the screen. Default: the link 'screen'.",
        show_default=False,
        rich_help_panel=RIG,
    ),
]
Lasers = Annotated[
    list[str] | None,
    typer.Option(
        "--laser",
        metavar="LINK",
        help="Laser link, beam along +z; repeatable. Default: every link 'laser_<digits>'.",
        show_default=False,
        rich_help_panel=RIG,
    ),
]
RigOption = Annotated[
    Path | None,
    typer.Option("--rig", metavar="YAML", help="rig.yaml: links, error models, noise, priors.", show_default=False, rich_help_panel=RIG),
]
BoardLink = Annotated[
    str | None,
    typer.Option(
        metavar="LINK=COLSxROWS:SQUARE",
        help="A link that is a board, by its INNER corners, e.g. board=9x6:25mm.",
        show_default=False,
        rich_help_panel=RIG,
    ),
]
Model = Annotated[
    ErrorModelName | None,
    typer.Option("--error-model", help="Which errors a joint can have. Default: auto.", show_default=False, rich_help_panel=EXPERT),
]
Estimate = Annotated[
    list[Addition] | None,
    typer.Option(
        "--estimate",
        help="Also estimate the whole placement of the screen, two or four numbers a beam, or cameras' lenses; repeatable. Default: none.",
        show_default=False,
        rich_help_panel=EXPERT,
    ),
]
Fix = Annotated[
    list[str] | None,
    typer.Option(
        "--fix", metavar="PATTERN", help="Hold these parameters, e.g. 'joint3.*'; repeatable.", show_default=False, rich_help_panel=EXPERT
    ),
]
Only = Annotated[
    list[str] | None,
    typer.Option(
        "--only", metavar="PATTERN", help="Estimate these parameters alone; repeatable.", show_default=False, rich_help_panel=EXPERT
    ),
]
JointSigma = Annotated[
    float | None,
    typer.Option(metavar="DEG", help="Noise of a joint reading in deg. Default: 0.", show_default=False, rich_help_panel=EXPERT),
]
PriorJoint = Annotated[
    str | None,
    typer.Option(
        metavar="MM,DEG", help="Prior sigma of joint errors, or flat. Default: 10mm,1deg.", show_default=False, rich_help_panel=EXPERT
    ),
]
PriorMount = Annotated[
    str | None,
    typer.Option(metavar="MM,DEG", help="... of the module's mount. Default: 20mm,2deg.", show_default=False, rich_help_panel=EXPERT),
]
PriorScreen = Annotated[
    str | None,
    typer.Option(metavar="MM,DEG", help="... of the screen's placement. Default: 100mm,5deg.", show_default=False, rich_help_panel=EXPERT),
]
PriorBeams = Annotated[
    str | None, typer.Option(metavar="MM,DEG", help="... of the beams. Default: 5mm,1deg.", show_default=False, rich_help_panel=EXPERT)
]
Json = Annotated[bool, typer.Option("--json", help="Print the result for machines, in SI units.", rich_help_panel=OUTPUT)]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="No warnings and no progress.", rich_help_panel=OUTPUT)]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="Say more about what is going on.", rich_help_panel=OUTPUT)]
Seed = Annotated[int, typer.Option(min=0, help="Seed of the random numbers.", rich_help_panel=EXPERT)]
Formats = Annotated[
    list[FormatName] | None,
    typer.Option(
        "--format",
        metavar="FORMAT",
        help=f"What to write, of {', '.join(FormatName)}. origins-yaml has x y z roll pitch yaw of every joint, offsets has joint offsets "
        "alone; rising and ros2-control are URDFs with the zeros in <calibration rising>, or in a transmission's <offset>; ur, xarm, "
        "franka, flexiv and tesseract are kinematics files as these read them; xacro is a patch of your own sources. Repeatable, all go "
        "beside the first. Default: urdf.",
        show_default=False,
    ),
]
UrHash = Annotated[
    Path | None,
    typer.Option(
        "--ur-hash-from",
        metavar="YAML",
        help="Take the hash of the ur format from this kinematics file of the very robot. Default: none is written.",
        show_default=False,
        rich_help_panel=EXPERT,
    ),
]
Split = Annotated[
    bool,
    typer.Option(
        "--split",
        help="Of the xacro format: a number that feeds several joints becomes a parameter of its macro, for each joint its own.",
        rich_help_panel=EXPERT,
    ),
]
InPlace = Annotated[
    bool,
    typer.Option("--in-place", help="Also change the xacro's sources themselves; each is kept as .orig.", rich_help_panel=EXPERT),
]
XacroFolder = Annotated[
    Path | None,
    typer.Option(
        "--xacro-folder",
        metavar="DIR",
        help="Also write changed copies of the xacro's sources, with all that they read, into a new folder.",
        show_default=False,
        rich_help_panel=EXPERT,
    ),
]
WriteFrames = Annotated[
    bool,
    typer.Option(
        "--write-frames",
        help="Also correct the fixed joints of links that were measured on, so that each stands where its frame (tool, camera, board) was "
        "found.",
        rich_help_panel=OUTPUT,
    ),
]
AddFrames = Annotated[
    bool,
    typer.Option("--add-frames", help="Also add the frames that were found as links of their own.", rich_help_panel=OUTPUT),
]
FrameNames = Annotated[
    list[str] | None,
    typer.Option(
        "--frame",
        metavar="NAME[=LINK]",
        help="Which of the frames --write-frames and --add-frames mean, and what an added link is called; repeatable. Default: all.",
        show_default=False,
        rich_help_panel=OUTPUT,
    ),
]
Reference = Annotated[
    str | None,
    typer.Option(
        metavar="LINK",
        help="Link that points and orientations are measured from. Default: the link 'tracker', else the root.",
        show_default=False,
        rich_help_panel=RIG,
    ),
]
ReferenceKnown = Annotated[
    bool,
    typer.Option(
        "--reference-known", help="The reference link itself is what is measured from: no placement is estimated.", rich_help_panel=EXPERT
    ),
]
TargetKnown = Annotated[
    bool,
    typer.Option(
        "--target-known",
        help="What is measured is each target's link itself, as a controller states it: no offset is estimated.",
        rich_help_panel=EXPERT,
    ),
]
After = Annotated[
    Path | None,
    typer.Option(
        metavar="YAML",
        help="Calibration of another branch, whose URDF ROBOT is: what it decided is the prior of the joints that both have.",
        show_default=False,
        rich_help_panel=EXPERT,
    ),
]
Target = Annotated[
    str | None,
    typer.Option(
        metavar="LINK",
        help="Link that columns named x, y, z, qx ... alone, or x1, y1, phix1 (figaroh's), are measured on.",
        show_default=False,
        rich_help_panel=RIG,
    ),
]
CameraOption = Annotated[
    Path | None,
    typer.Option(
        "--camera",
        metavar="YAML",
        help="Camera that <laser>.u .v, or <link>.u .v, were read with, in px; spots are then taken from the pictures.",
        show_default=False,
        rich_help_panel=RIG,
    ),
]
Payloads = Annotated[
    list[str] | None,
    typer.Option(
        "--payload",
        metavar="KG@LINK",
        help="Mass in kg that hangs on a link, e.g. 2.5@tool0; repeatable.",
        show_default=False,
        rich_help_panel=EXPERT,
    ),
]
Overwrite = Annotated[
    bool,
    typer.Option("--overwrite", help="Also replace files that are no earlier result of the same inputs; never an input, never a device."),
]
Output = Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="Where to write.", show_default=False)]
