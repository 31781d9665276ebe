"""What `urdfcal simulate` writes of one robot: its measurements, with what a fit has to be told in their comments, and the truth."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from urdfcal.calibration.rig_file import RigFile
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.parameters import INSTRUMENTS
from urdfcal.output.calibration_yaml import truth_yaml
from urdfcal.robot.corrections import OriginCorrection
from urdfcal.robot.robot import Robot
from urdfcal.robot.sheet import ScreenArea
from urdfcal.sensors.columns import NONE, Stations
from urdfcal.sensors.measurements_csv import measurements_csv
from urdfcal.simulation.readings import ReadingNoise
from urdfcal.simulation.setup import SimulatedSensor, SimulatedSetup
from urdfcal.simulation.sights import several
from urdfcal.simulation.simulated import simulated_by
from urdfcal.simulation.truth import SagScales, sag_bytes, soft_truth, truth_of


@dataclass(frozen=True)
class MadeFiles:
    """Of one robot.

    Attributes:
        measurements: Content of the CSV.
        truth: Content of the YAML.
        setup: The robot, and where everything stands that measures it.
        poses: How many.
        looked: How many were drawn for them.
        again: That and why some were drawn again, in a line or none.
    """

    measurements: bytes
    truth: bytes
    setup: SimulatedSetup
    poses: int
    looked: int
    again: list[str]


@dataclass(frozen=True)
class Simulator:
    """What is simulated, whatever the seed.

    Attributes:
        arm: Nominal robot, as its sensors see it.
        errors: Of the joints, as the command line states them.
        poses: How many to fit, and how many to test.
        noise: Of what is read.
        sensors: What reads beside lasers.
        lasers: Whether lasers do.
        area: The screen.
        rig: What is known of both ends, and boards.
        stations: Instruments that have names, and their cameras.
        lens: What pixels of an instrument without a camera of its own are read with.
        soft: How joints give way.
        sizes: Noises by name, for people.
        bent: How soft it is by name, for people.
        distribution: Of the noise.
    """

    arm: Robot
    errors: str
    poses: tuple[int, int]
    noise: ReadingNoise
    sensors: tuple[SimulatedSensor, ...]
    lasers: bool
    area: ScreenArea
    rig: RigFile
    stations: Stations = NONE
    lens: Any = None
    soft: SagScales = field(default_factory=SagScales)
    sizes: Mapping[str, float] = field(default_factory=dict)
    bent: Mapping[str, float] = field(default_factory=dict)
    distribution: str = "gaussian"

    def made(self, seed: int, camera: Path | None = None, rig: Path | None = None) -> MadeFiles:
        """The robot of a seed; the files of its camera and rig are named to who fits it."""
        rng = np.random.default_rng(seed)
        model, x = truth_of(self.arm, self.errors, rng)
        if self.soft:
            model, x = soft_truth(self.arm, model, x, self.soft, rng)
        setup, found = simulated_by(
            self.arm,
            model,
            x,
            self.sensors,
            self.poses,
            rng,
            self.noise,
            area=self.area,
            reference_known=self.rig.reference_known,
            target_known=self.rig.target_known,
            camera=self.lens,
            boards=self.rig.grids(),
            stations=self.stations,
        )
        again = _drawn_again(len(found.data), found.looked, self.lasers, setup)
        comments = [*self._comments(seed), *again, *_advice(setup, camera, rig)]
        truth = self._truth(setup, seed)
        return MadeFiles(measurements_csv(found.data, comments), truth, setup, len(found.data), found.looked or len(found.data), again)

    @property
    def _spots(self) -> bool:
        return self.lasers or any(own.aimed for own in self.sensors)

    def _comments(self, seed: int) -> list[str]:
        bent = f"; {_in_words(self.bent)}" if self.bent else ""
        return [
            f"SIMULATED measurements of {self.arm.name}, made by urdfcal simulate; no robot has been measured.",
            f"seed {seed}, {self.distribution} noise: {_in_words(self.sizes)}; errors: {Path(self.errors).name}{bent}",
            "joints in rad (m where they slide), lengths in m" + (", spots (y, z) on the screen" if self._spots else ""),
        ]

    def _truth(self, setup: SimulatedSetup, seed: int) -> bytes:
        model, x, joints = setup.errors, setup.x, self.arm.tree.joints
        corrections = {
            name: OriginCorrection(joints[name].origin, origin, joints[name].moves) for name, origin in model.corrected_origins(x).items()
        }
        stated = {"distribution": self.distribution, **self.sizes, "seed": seed}
        truth = truth_yaml(self.arm, corrections, _robots_own(model, x), sys.argv, stated) + sag_bytes(model, x)
        if self.sensors:
            truth += yaml.safe_dump({"instruments": setup.entries()}, sort_keys=False, default_flow_style=None, width=160).encode()
        return truth


def _robots_own(model: ErrorModel, x: Any) -> dict[str, float]:
    return {own.name: value for own, value in zip(model.parameters, x, strict=True) if own.kind not in (*INSTRUMENTS, "soft")}


def _in_words(sizes: Mapping[str, float]) -> str:
    """`spot 1 mm, joint 0 deg`."""
    return ", ".join("{} {:g} {}".format(name.rpartition("_")[0], size, name.rpartition("_")[2]) for name, size in sizes.items())


def _drawn_again(poses: int, looked: int, lasers: bool, setup: SimulatedSetup) -> list[str]:
    """How many random poses were passed over, and why; nothing where none was."""
    if looked <= poses:
        return []
    wanted = [f"with every beam on the screen of {setup.area}"] if lasers else []
    wanted += ["with the beams of an arm on the screen that they name"] if any(own.aimed for own in setup.sensors) else []
    wanted += [f"with {'a' if several(setup) else 'the'} board in the picture"] if setup.pictured else []
    return [f"{looked - poses} of {looked} random poses were drawn again, for {poses} {' and '.join(wanted)}"]


def _advice(setup: SimulatedSetup, camera: Path | None, rig: Path | None) -> list[str]:
    """What a fit has to be told beyond the file: the reference link, the camera, boards, a length where only touches were made."""
    instruments, lines = setup.robot.rig.instruments, []
    if any(own.placed for own in instruments.every):
        kinds = {slot.kind for slot in setup.errors.slots if slot.found}
        known = "".join(f" --{kind}-known" for kind in ("reference", "target") if kind not in kinds)
        by = "" if instruments.name else f" --reference {instruments.reference}"
        by += known + (f" --camera {camera}" if camera is not None else "") + (f" --rig {rig}" if rig else "")
        frames = " and ".join(own.name or instruments.reference for own in instruments.every)
        lines.append(f"measured from {frames}: urdfcal fit ...{by}")
    if setup.boards and setup.pictured:
        entries = ", ".join(f"{link}: '{grid}'" for link, grid in setup.boards.items())
        lines.append(f"for a rig.yaml: boards: {{{entries}}}")
    sockets = [place.name for place in instruments.places if place.name.startswith("socket:")]
    apart = {
        f"{one.removeprefix('socket:')} - {other.removeprefix('socket:')}": float(np.linalg.norm(setup.place(one) - setup.place(other)))
        for one, other in pairwise(sockets)
    }
    if apart:
        lengths = ", ".join(f"'{pair}': {length * 1e3:.3f}" for pair, length in apart.items())
        lines.append(f"true distances, for a rig.yaml: sockets: {{distances_mm: {{{lengths}}}}}")
    return lines
