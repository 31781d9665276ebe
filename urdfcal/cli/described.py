"""How the list of commands tells of each: its group, a line of at most 80 columns, and an example for its own help."""

from __future__ import annotations

from typing import Any, NamedTuple

LASERS, TRYING, RESULTS = "Laser spots in pictures", "Trying it out", "Robots and results"

CODES = """\
urdfcal COMMAND --help tells of each, with an example.

Exit codes: 0 done; 2 bad input or usage, nothing written; 3 no calibration to
be trusted; 70 an error of ours; 130 interrupted (Ctrl-C), nothing written,
or the best so far where it says so."""


class Described(NamedTuple):
    """What is said of a command: a line, an example, and the group that it is in; the empty string for the first."""

    line: str
    example: str
    group: str = ""


COMMANDS = {
    "fit": Described("Calibrate: measurements in, a corrected URDF out.", "urdfcal fit robot.urdf measured.csv --holdout 0.3"),
    "measurements": Described(
        "Say what is understood of a file of measurements.", "urdfcal measurements robot.urdf tracker.csv --target tool0"
    ),
    "check": Described("Tell what measurements can and cannot determine.", "urdfcal check robot.urdf measured.csv"),
    "evaluate": Described("Print how far a URDF is from what was measured.", "urdfcal evaluate robot_calibrated.urdf measured.csv"),
    "view": Described("Show robot and measurements in the browser.", "urdfcal view robot.urdf measured.csv --html view.html"),
    "dh": Described("Print the D-H table derived from a URDF.", "urdfcal dh robot.urdf --tip tool0", RESULTS),
    "rig": Described(
        "Put module and screen, board or target on a URDF.", "urdfcal rig robot.urdf --tip tool0 --screen 1.3,0,0.5 -o cell.urdf", RESULTS
    ),
    "apply": Described(
        "Put a stored calibration on a robot description.",
        "urdfcal apply robot.urdf robot_calibration.yaml -o robot_calibrated.urdf",
        RESULTS,
    ),
    "correct": Described(
        "Correct targets for a controller that keeps its geometry.",
        "urdfcal correct robot.urdf targets.csv --calibration cal.yaml -o out.csv",
        RESULTS,
    ),
    "import": Described(
        "Take a maker's own calibration in as one of ours.",
        "urdfcal import ur5e.urdf my_ur5e.yaml -o ur5e_calibration.yaml",
        RESULTS,
    ),
    "compare": Described(
        "Compare two calibrations or URDFs of one robot.", "urdfcal compare monday_calibration.yaml friday_calibration.yaml", RESULTS
    ),
    "simulate": Described(
        "Simulate measurements of a robot with known errors.", "urdfcal simulate robot.urdf -o try.csv --sensor point:tool0", TRYING
    ),
    "poses": Described("Choose which poses to measure, and in which order.", "urdfcal poses robot.urdf -o poses.csv --sensor point:tool0"),
    "fleet": Described("Calibrate many robots, and say who stands out.", "urdfcal fleet fleet.csv -o fleet/ --fit '--no-sag'"),
    "paper": Described(
        "Repeat the paper's tables beside the published ones.", "urdfcal paper --report paper.html --latex tables.tex", TRYING
    ),
    "camera": Described(
        "Calibrate a camera: its lens, and where the screen is.",
        "urdfcal camera views/ --screen screen.png --markers screen.yaml -o camera.yaml",
        LASERS,
    ),
    "boards": Described(
        "Find calibration boards in pictures.",
        "urdfcal boards pictures/ --board 9x6:25mm --camera camera.yaml -o corners.csv",
        LASERS,
    ),
    "markers": Described(
        "Make boards, or the screen's markers, to print.", "urdfcal markers --board charuco:7x5:40mm:30mm --paper A3 -o board.pdf", LASERS
    ),
    "spots": Described("Find laser spots in pictures.", "urdfcal spots pictures/ --camera camera.yaml -o spots.csv", LASERS),
    "render": Described(
        "Make the pictures that a camera would have taken.", "urdfcal render robot.urdf poses.csv -o pictures/ --camera camera.yaml", LASERS
    ),
    "module": Described("Find the true beam directions on the bench.", "urdfcal module bench.csv -o module.yaml", LASERS),
    "version": Described("Print the version.", "urdfcal version", RESULTS),
}


def described(command: str) -> dict[str, Any]:
    """What typer is told of a command by its name; nothing of one that is not listed here."""
    if command not in COMMANDS:
        return {}
    own = COMMANDS[command]
    return {"short_help": own.line, "epilog": own.example, "rich_help_panel": own.group or None}
