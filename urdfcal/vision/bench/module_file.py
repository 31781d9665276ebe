"""`module.yaml`: what a bench says of a module, as a rig file that `fit --rig` takes as it is.

    # laser_1: Rot(x, -27.80 +- 0.05 deg) Rot(y, 1.27 +- 0.04 deg) ...
    estimate: [beams]
    beams:
      laser_1: [0.0207, 0.4663, 0.8844]
    parameters:
      laser_1.rot_x: {value_deg: 2.2, sigma_deg: 0.05}

The parameters are the corrections that `--estimate beams` estimates, relative to the beams of a URDF: those of the robot that was named,
or, where none was, of a URDF that already holds the bench's angles, so that the values are zero. `beams` says where those point, in
module axes, and a robot whose beams point elsewhere is refused. The bench's own angles stand in the comments.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from urdfcal.base.errors import UsageError, no_such
from urdfcal.base.geometry import DEG, MM, Matrix
from urdfcal.base.tables import Table
from urdfcal.robot.robot import Robot
from urdfcal.vision.bench.beams import BenchResult, beam_direction, relative_angles
from urdfcal.vision.bench.misreadings import Misreading


def beam_priors(result: BenchResult, robot: Robot | None = None) -> dict[str, tuple[float, float]]:
    """Value and sigma of every beam's two corrections, [rad].

    Args:
        result: What the bench says.
        robot: The robot whose nominal beams the values are relative to; None for one that holds the bench's angles.

    Raises:
        UsageError: the robot has no laser of that name.
    """
    priors: dict[str, tuple[float, float]] = {}
    for index, laser in enumerate(result.lasers):
        (a, b), block = result.angles[index], result.covariance[4 * index : 4 * index + 2, 4 * index : 4 * index + 2]
        nominal = _reference(result, index, robot)
        values = relative_angles(nominal, a, b)
        turn = _differences(nominal, a, b)
        sigmas = np.sqrt(np.diag(turn @ block @ turn.T))
        priors |= {f"{laser}.rot_{axis}": (float(values[k]), float(sigmas[k])) for k, axis in enumerate("xy")}
    return priors


def _reference(result: BenchResult, index: int, robot: Robot | None) -> Matrix:
    """Axes of a laser in module axes that its corrections are relative to, (3, 3)."""
    return _axes(*result.angles[index]) if robot is None else nominal_axes(robot, result.lasers[index])


def nominal_axes(robot: Robot, laser: str) -> Matrix:
    """A laser's axes in its module's, (3, 3)."""
    if laser not in robot.rig.lasers:
        raise UsageError(no_such("laser", laser, robot.rig.lasers))
    return robot.chain.laser_axes(robot.rig.lasers.index(laser))


def _axes(a: float, b: float) -> Matrix:
    """Rot(x, a) Rot(y, b)."""
    z = beam_direction(a, b)
    y = np.array([0.0, np.cos(a), np.sin(a)])
    return np.column_stack([np.cross(y, z), y, z])


def _differences(nominal: Matrix, a: float, b: float, step: float = 1e-6) -> Matrix:
    """Derivative of the corrections by a and b, (2, 2)."""
    by_a = relative_angles(nominal, a + step, b) - relative_angles(nominal, a - step, b)
    by_b = relative_angles(nominal, a, b + step) - relative_angles(nominal, a, b - step)
    return np.column_stack([by_a, by_b]) / (2 * step)


def module_yaml(result: BenchResult, squareness: float, robot: Robot | None = None, notes: Sequence[str] = ()) -> bytes:
    """The file.

    Args:
        result: What the bench says.
        squareness: That was stated, [rad].
        robot: See `beam_priors`.
        notes: What was left out, and why.
    """
    how = "stated" if result.stated else "estimated from the residual"
    lines = [
        "# Beams of a laser module, by urdfcal module; a beam is Rot(x, a) Rot(y, b) applied to the module's +z",
        *(f"# {line}" for line in described(result)),
        f"# noise of a reading {result.noise / MM:.3f} mm ({how}); the plane's squareness, {squareness / DEG:g} deg, is in the sigmas",
        *(f"# {note}" for note in notes),
        "# in a URDF with slm.urdf.xacro:",
        *(f"#   {argument}" for argument in xacro_arguments(result)),
        "# The parameters below are relative to the beams of "
        + ("a URDF that holds these angles" if robot is None else f"{robot.name} as its URDF has them"),
        "estimate: [beams]",
        "beams:",
    ]
    for index, laser in enumerate(result.lasers):
        lines.append(f"  {laser}: [{', '.join(f'{part:.9f}' for part in _reference(result, index, robot)[:, 2])}]")
    lines.append("parameters:")
    lines += [
        f"  {name}: {{value_deg: {value / DEG:.8g}, sigma_deg: {sigma / DEG:.4g}}}"
        for name, (value, sigma) in beam_priors(result, robot).items()
    ]
    return ("\n".join(lines) + "\n").encode()


def xacro_arguments(result: BenchResult) -> list[str]:
    """What the macro `slm` takes, two arguments a laser."""
    return [
        f'{laser}_rot_x="{a / DEG:.6f}" {laser}_rot_y="{b / DEG:.6f}"' for laser, (a, b) in zip(result.lasers, result.angles, strict=True)
    ]


def described(result: BenchResult) -> list[str]:
    """The result in lines of text."""
    lines = []
    sigma = np.sqrt(np.diag(result.covariance)).reshape(-1, 4)
    for index, name in enumerate(result.lasers):
        (a, b), (x0, y0) = result.angles[index] / DEG, result.origins[index] / MM
        lines.append(
            f"{name}: Rot(x, {a:.4f} +- {sigma[index, 0] / DEG:.4f} deg) Rot(y, {b:.4f} +- {sigma[index, 1] / DEG:.4f} deg), "
            f"crosses the module's origin plane at ({x0:.2f} +- {sigma[index, 2] / MM:.2f}, {y0:.2f} +- {sigma[index, 3] / MM:.2f}) mm"
        )
    if result.apex is not None:
        x, y, z = result.apex / MM
        lines.append(f"the beams come nearest to each other at ({x:.2f}, {y:.2f}, {z:.2f}) mm from the module's origin")
    (row, laser), aside = result.worst, np.linalg.norm(result.residual[result.worst])
    lines.append(
        f"readings fit to {result.rms / MM:.3f} mm (RMS), the worst to {aside / MM:.3f} mm: {_place(result, row, [result.lasers[laser]])}"
    )
    return lines


def misreadings(result: BenchResult, left_out: Sequence[Misreading], doubtful: Sequence[Misreading], table: Table) -> list[str]:
    """What does not fit, in lines of text."""
    lines = []
    for wrong in left_out:
        lies, guess = ("lies", "the reading") if len(wrong.lasers) == 1 else ("lie up to", "the distance, or all of the row,")
        lines.append(
            f"{table.path}:{table.lines[wrong.row]}: {_place(result, wrong.row, wrong.lasers)} {lies} {wrong.off / MM:.1f} mm from where "
            f"the other readings have it, and {'is' if len(wrong.lasers) == 1 else 'are'} left out; is {guess} mistyped?"
        )
    if doubtful:
        places = " or ".join(f"{_place(result, wrong.row, wrong.lasers)} (line {table.lines[wrong.row]})" for wrong in doubtful)
        lines.append(f"{table.path}: {places} does not fit the other readings, which are too few to do without it; read more distances")
    return lines


def _place(result: BenchResult, row: int, lasers: Sequence[str]) -> str:
    return f"{' and '.join(lasers)} at {result.distance[row] / MM:g} mm"
