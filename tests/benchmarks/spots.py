"""Spots in simulated pictures by random cameras, and in real photographs: found, missed, false, swapped, and how far off.

python tests/benchmarks/spots.py [--cameras N] [--pictures N a camera and kind] [--data DIR]

Cameras look at the screen from up to 50 deg off its normal, 1 to 2 mm a pixel, k1 from -0.25 to 0.02. Kinds of pictures:

    clean       two spots that do not clip
    clipped     two spots 2 to 10 times brighter than full scale, with a halo
    hard        a red and a green spot, 10 % missing, glare, uneven light, half of them with a mosaic and the sRGB curve
    glare only  lamps, glints, streaks, lens reflections and no spot

The photographs are those of `laser_photos` in the folder of shared data; they are not part of this project.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import Vector
from urdfcal.sensors.camera import Camera
from urdfcal.vision.pictures import picture_from, read_picture
from urdfcal.vision.render.image_sensor import ImageSensor
from urdfcal.vision.render.light import Beam, Lighting, backdrop, glare, spot_light
from urdfcal.vision.spots.detector import PixelSpot, find_spots
from urdfcal.vision.spots.labels import label_spots
from urdfcal.vision.spots.series import put_together
from urdfcal.vision.spots.table import sigma_on_screen

KINDS = ("clean", "clipped", "hard", "glare only")
PHOTOS = {"crop_1": (595.6, 288.6), "crop_4": (595.7, 288.7), "crop_5": (595.9, 288.8), "green_closeup": None}
SAME_PX = 5.0


@dataclass
class Tally:
    """What came of one kind of picture."""

    pictures: int = 0
    shown: int = 0
    false: int = 0
    swapped: int = 0
    px: list[float] = field(default_factory=list)
    mm: list[float] = field(default_factory=list)
    ratio: list[float] = field(default_factory=list)
    missed: list[str] = field(default_factory=list)

    def line(self, kind: str) -> str:
        """A row of the table."""
        head = f"{kind:10s} {self.pictures:4d} pictures {self.shown:4d} spots: found {len(self.px):4d} missed {len(self.missed):3d} "
        head += f"false {self.false:2d} swapped {self.swapped:2d}"
        if not self.px:
            return head
        px, mm = ([float(np.median(v)), float(np.quantile(v, 0.95)), max(v)] for v in (self.px, self.mm))
        sigma = f"RMS of error over sigma {np.sqrt(np.mean(np.square(self.ratio))):.2f}"
        return f"{head}; median, 95 %, max: {px[0]:.3f} {px[1]:.3f} {px[2]:.3f} px, {mm[0]:.3f} {mm[1]:.3f} {mm[2]:.3f} mm; {sigma}"


def random_camera(rng: np.random.Generator, size: tuple[int, int] = (1280, 960)) -> Camera:
    """A camera that looks at the middle of the screen."""
    tilt, azimuth, roll = np.radians(rng.uniform(0, 50)), rng.uniform(0, 2 * np.pi), rng.uniform(-0.1, 0.1)
    away, mm_per_px, k1 = rng.uniform(1.5, 3.0), rng.uniform(1.0, 2.0), rng.uniform(-0.25, 0.02)
    back = np.array([-np.cos(tilt), np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth)])
    across = np.cross(-back, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    rotation = pin.utils.rotate("z", roll) @ np.stack([across, np.cross(-back, across), -back])
    focal, (u, v) = away / (mm_per_px * 1e-3), np.array(size) / 2 + rng.uniform(-20, 20, 2)
    distortion = np.array([k1, -0.2 * k1 * rng.uniform(), *rng.normal(0, 5e-4, 2), 0.0])
    return Camera(
        size, np.array([[focal, 0, u], [0, focal, v], [0, 0, 1]]), distortion, "plain", pin.SE3(rotation, -rotation @ (back * away))
    )


def random_beams(kind: str, rng: np.random.Generator) -> list[Beam]:
    """How the two lasers look."""
    colours = {"hard": ("red", "green")}.get(kind) or (str(rng.choice(["red", "green"])),) * 2
    brightness = rng.uniform(0.4, 0.95) if kind == "clean" else rng.uniform(2, 10) if kind == "clipped" else rng.uniform(0.6, 6)
    halo = 0.0 if kind == "clean" else rng.uniform(0.01, 0.08)
    return [Beam(colour, rng.uniform(0.8e-3, 1.5e-3), brightness, halo, rng.uniform(2.5, 6), rng.uniform(0.5, 0.9)) for colour in colours]


def picture(
    kind: str, camera: Camera, behind: np.ndarray, sensor: ImageSensor, rng: np.random.Generator
) -> tuple[np.ndarray, dict[str, Vector], list[Beam]]:
    """A picture, the true centres in it by laser, and the lasers."""
    light = behind.copy()
    if kind in ("hard", "glare only"):
        light += glare(camera.size, int(rng.integers(2, 9)), rng)
    beams, truth = random_beams(kind, rng), {}
    for index, beam in enumerate([] if kind == "glare only" else beams):
        if kind == "hard" and rng.random() < 0.1:
            continue
        at = rng.uniform(20, np.array(camera.size) - 20)
        spot = camera.spots_of_pixels(at[None])[0]
        incidence, turn = np.radians(rng.uniform(0, 60)), rng.uniform(0, 2 * np.pi)
        direction = np.array([np.cos(incidence), np.sin(incidence) * np.cos(turn), np.sin(incidence) * np.sin(turn)])
        own, rows, columns = spot_light(camera, spot, direction, beam) or (None, None, None)
        light[rows, columns] += own
        truth[f"laser_{index + 1}"] = camera.pixels_of_spots(spot[None])[0]
    return sensor.expose(light, rng), truth, beams


def judge(tally: Tally, camera: Camera, pixels: np.ndarray, truth: dict[str, Vector], beams: list[Beam]) -> None:
    """Compare what is found with what was shown."""
    sighting = find_spots(picture_from(pixels))
    left: list[PixelSpot] = list(sighting.spots)
    tally.pictures += 1
    tally.shown += len(truth)
    for centre in truth.values():
        near = [spot for spot in left if np.linalg.norm(spot.centre - centre) < SAME_PX]
        if not near:
            why = [other.reason for other in sighting.refused if np.linalg.norm(other.centre - centre) < 3 * SAME_PX]
            tally.missed.append(why[0] if why else "no candidate")
            continue
        spot = min(near, key=lambda spot: float(np.linalg.norm(spot.centre - centre)))
        left.remove(spot)
        tally.px.append(float(np.linalg.norm(spot.centre - centre)))
        off = camera.spots_of_pixels(spot.centre[None])[0] - camera.spots_of_pixels(centre[None])[0]
        tally.mm.append(float(np.linalg.norm(off)) * 1e3)
        tally.ratio.append(float(np.linalg.norm(off)) / np.sqrt(2) / sigma_on_screen(camera, spot))
    tally.false += len(left)
    if beams[0].colour != beams[1].colour:
        colours = tuple(beam.colour for beam in beams)
        labelled = label_spots([put_together("", [sighting])], ("laser_1", "laser_2"), lambda spot: spot.centre, colours=colours).spots[0]
        others = {"laser_1": "laser_2", "laser_2": "laser_1"}
        tally.swapped += sum(
            others[name] in truth and float(np.linalg.norm(spot.centre - truth[others[name]])) < SAME_PX for name, spot in labelled.items()
        )


def photographs(folder: Path) -> None:
    """What is found in the real photographs, by colours asked for."""
    for name, label in PHOTOS.items():
        for colours in (("red", "green"), ("red",) if label else ("green",)):
            found = find_spots(read_picture(folder / f"{name}.png"), colours)
            print(f"{name}, looking for {' and '.join(colours)}; label {label or 'none'}")
            for spot in found.spots:
                off = f", {np.linalg.norm(spot.centre - label):.1f} px from the label" if label else ""
                sigma = float(np.sqrt(np.trace(spot.covariance) / 2))
                print(
                    f"    {spot.colour} at ({spot.centre[0]:.1f}, {spot.centre[1]:.1f}) +- {sigma:.1f} px, {spot.clipped} px clipped{off}"
                )
            for other in found.refused[:4]:
                print(f"      refused ({other.centre[0]:.0f}, {other.centre[1]:.0f}): {other.reason}")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cameras", type=int, default=10)
    parser.add_argument("--pictures", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--data", type=Path, default=Path(__file__).parents[3] / "shared" / "data")
    arguments = parser.parse_args()
    tallies = {kind: Tally() for kind in KINDS}
    for number in range(arguments.cameras):
        rng = np.random.default_rng([arguments.seed, number])
        camera = random_camera(rng)
        behind = backdrop(camera, Lighting(rng.uniform(0.05, 0.4), rng.uniform(0, 0.8), rng.uniform(0, 2 * np.pi)))
        for kind, tally in tallies.items():
            for index in range(arguments.pictures):
                real = kind == "hard" and index % 2 == 1
                judge(tally, camera, *picture(kind, camera, behind, ImageSensor(mosaic=real, tone=real), rng))
        print(f"camera {number + 1} of {arguments.cameras}", flush=True)
    for kind, tally in tallies.items():
        print(tally.line(kind))
        for reason in sorted(set(tally.missed)):
            print(f"    missed {tally.missed.count(reason)}: {reason}")
    photos = arguments.data / "laser_photos"
    if photos.is_dir():
        photographs(photos)
    else:
        print(f"no photographs: {photos} is not there")


if __name__ == "__main__":
    main()
