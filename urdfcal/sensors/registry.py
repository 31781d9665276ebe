"""The sensors by name: the one list from which everything else knows what can be measured."""

from __future__ import annotations

from collections.abc import Mapping

from urdfcal.sensors.inclinometer import InclinometerSensor
from urdfcal.sensors.pixels import PixelSensor
from urdfcal.sensors.sensor import Sensor, Words
from urdfcal.sensors.spots import AimedSpotSensor, SpotPixelSensor, SpotSensor
from urdfcal.sensors.targets import DistanceSensor, OrientationSensor, PlaneSensor, PointSensor, SocketSensor

SENSORS: Mapping[str, Sensor] = {
    sensor.name: sensor
    for sensor in (
        SpotSensor(),
        PointSensor(),
        OrientationSensor(),
        DistanceSensor(),
        PlaneSensor(),
        SocketSensor(),
        PixelSensor(),
        SpotPixelSensor(),
        InclinometerSensor(),
        AimedSpotSensor(),
    )
}
WORDS: Mapping[str, Words] = {sensor.noise: sensor.words for sensor in SENSORS.values()}


def start_sigma_of(noise: str) -> float:
    """Noise of a kind before any is known, [m], [rad] or [px]."""
    return WORDS[noise].start_sigma * WORDS[noise].size


def noun(noise: str, count: int = 2) -> str:
    """What one reading of a kind of noise is called, or several."""
    return WORDS[noise].one if count == 1 else WORDS[noise].several
