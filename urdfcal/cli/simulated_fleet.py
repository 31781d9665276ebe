"""What `urdfcal simulate --robots` writes: a folder that needs nothing else, and whose manifest `urdfcal fleet` takes as it is."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

import yaml

from urdfcal.base.tables import csv_text
from urdfcal.calibration.rig_file import RigFile
from urdfcal.cli.simulated_files import Simulator
from urdfcal.fleet.manifest import COLUMNS

MANIFEST, RIG, CAMERA = "manifest.csv", "rig.yaml", "camera.yaml"


@dataclass(frozen=True)
class SimulatedFleet:
    """Robots of one model.

    Attributes:
        simulator: What is simulated of each.
        rig: What a fit has to know of the rig.
        bends: Words for a fit of what bends the robots.
        lens: Content of the camera's file.
    """

    simulator: Simulator
    rig: RigFile
    bends: tuple[str, ...] = ()
    lens: bytes | None = None

    def write(self, folder: Path, seeds: range, advance: Callable[[], None]) -> int:
        """Everything into a folder; how many poses each robot has.

        Raises:
            UsageError: poses that sensors can read are too rare.
        """
        names = [f"robot{number:0{len(str(len(seeds)))}}" for number in range(1, len(seeds) + 1)]
        rig, poses = self._rig(), 0
        for name, seed in zip(names, seeds, strict=True):
            made = self.simulator.made(seed, Path(CAMERA) if self.lens else None, Path(RIG) if rig else None)
            (folder / f"{name}.csv").write_bytes(made.measurements)
            (folder / f"{name}_truth.yaml").write_bytes(made.truth)
            poses = made.poses
            advance()
        beside = {self._description: self.simulator.arm.description.text, RIG: rig, CAMERA: self.lens, MANIFEST: self._manifest(names, rig)}
        beside |= {file: Path(self.rig.instruments[name].camera).read_bytes() for name, file in self._lenses.items()}
        for file, content in beside.items():
            if content:
                (folder / file).write_bytes(content)
        return poses

    @property
    def _description(self) -> str:
        return f"{self.simulator.arm.description.stem}.urdf"

    def _rig(self) -> bytes:
        """What a fit has to be told, as its rig.yaml; empty where that is nothing."""
        instruments = self.simulator.arm.rig.instruments
        named = {name: entry.model_copy(update={"camera": self._lenses.get(name, "")}) for name, entry in self.rig.instruments.items()}
        reference = instruments.reference if instruments.placed and not instruments.name else self.rig.reference
        told = self.rig.model_copy(update={"reference": reference, "instruments": named})
        entries = told.model_dump(mode="json", exclude_defaults=True)
        head = "# for every robot of this folder, written by urdfcal simulate\n"
        return (head + yaml.safe_dump(entries, sort_keys=False, allow_unicode=True)).encode() if entries else b""

    @property
    def _lenses(self) -> dict[str, str]:
        """Files of the folder for the cameras of the rig's instruments, by instrument."""
        sighted = [name for name, entry in self.rig.instruments.items() if entry.camera]
        return {name: f"camera_{number}.yaml" for number, name in enumerate(sighted, 1)}

    def _manifest(self, names: Iterable[str], rig: bytes) -> bytes:
        options = [*(("--rig", RIG) if rig else ()), *(("--camera", CAMERA) if self.lens else ()), *self.bends]
        rows = [(name, self._description, f"{name}.csv", shlex.join(options)) for name in names]
        comments = ["SIMULATED robots, made by urdfcal simulate; the truth of each is in its <name>_truth.yaml"]
        return csv_text(COLUMNS, rows, comments)
