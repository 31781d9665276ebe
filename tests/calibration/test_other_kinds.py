"""Test poses whose kinds of readings stand in another order than the fitted ones, or are fewer, or more."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from tests.support.sensor_cases import NOISE, SensorCase, setup_of
from urdfcal.api import Calibration, fit
from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import MM
from urdfcal.calibration.analysis.clusters import worst_clusters
from urdfcal.calibration.analysis.validation import coverage_warnings
from urdfcal.calibration.tested import with_test
from urdfcal.estimation.noise import Noise
from urdfcal.output.report.residuals import residuals_of
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.stated_noise import noise_for
from urdfcal.simulation.readings import simulate_readings


class Told(NamedTuple):
    """A fit of points, orientations and distances of one target, and poses that were not fitted: some readings of those are gross."""

    robot: Robot
    fitted: Measurements
    test: Measurements
    found: Calibration


@pytest.fixture(scope="module")
def told(robots: dict[str, Robot]) -> Told:
    rng = np.random.default_rng(3)
    setup = setup_of(SensorCase("ur5", ("pose:tool0", "distance:tool0")), robots, rng)
    data = simulate_readings(setup, 90, rng, NOISE)
    spoilt = next(each for each in data.readings if each.sensor == "distance").values.copy()
    spoilt[-3:] += 4 * MM
    data = replace(data, readings=tuple(replace(each, values=spoilt) if each.sensor == "distance" else each for each in data.readings))
    fitted, test = data.subset(np.arange(90) < 65), data.subset(np.arange(90) >= 65)
    return Told(setup.robot, fitted, test, fit(setup.robot, fitted))


def only(data: Measurements, kinds: Collection[str]) -> Measurements:
    """The same of some kinds alone."""
    return replace(data, readings=tuple(each for each in data.readings if each.sensor in kinds))


def test_noise_follows_its_kind(told: Told) -> None:
    """Each kind keeps its own sigma, statement and share in common wherever it stands; a new one has the usual noise, stated."""
    noise = Noise(np.array([1.0, 2.0]), np.zeros(6), np.array([True, False]), np.array([0.25, 0.5]))
    moved = noise_for(noise, ("orientation", "point"), told.test)
    assert moved.sigma == pytest.approx([2.0, 1.0, 0.5 * MM])
    assert moved.stated.tolist() == [False, True, True]
    assert moved.common == pytest.approx([0.5, 0.25, 1.0])
    assert noise_for(noise, ("orientation", "point"), only(told.test, ("orientation",))).sigma == pytest.approx([1.0])
    assert noise_for(noise, told.test.kinds, told.test) is noise


def test_the_order_of_kinds_does_not_matter(told: Told) -> None:
    """Distances, outliers, clusters, the warning and the lengths of residuals are those of the same poses in the fit's own order."""
    straight = with_test(told.found, told.test)
    turned = with_test(told.found, replace(told.test, readings=(*told.test.readings[1:], told.test.readings[0])))
    assert len(straight.test_outliers) == 3
    assert {(each.pose, each.laser) for each in turned.test_outliers} == {(each.pose, each.laser) for each in straight.test_outliers}
    assert turned.test is not None
    assert straight.test is not None
    assert {name: row.mean for name, row in turned.test[1].items()} == pytest.approx(
        {name: row.mean for name, row in straight.test[1].items()}
    )
    assert worst_clusters(turned) == worst_clusters(straight)
    assert coverage_warnings(told.robot, turned) == coverage_warnings(told.robot, straight)
    lengths = [{each.name: each.lengths for each in residuals_of(found) if each.label == "test"} for found in (straight, turned)]
    for name, length in lengths[0].items():
        np.testing.assert_allclose(lengths[1][name], length, rtol=1e-9)


def test_the_warning_tells_each_kind_apart(told: Told) -> None:
    """Poses that are a hundred times worse in one kind are named with the figures of their unit, in whatever order the kinds stand."""
    off = np.random.default_rng(0).normal(0, 10 * MM, (25, 3))
    far = replace(told.test, readings=tuple(replace(r, values=r.values + off) if r.sensor == "point" else r for r in told.test.readings))
    found = [with_test(told.found, data) for data in (far, replace(far, readings=(*far.readings[1:], far.readings[0])))]
    words = [coverage_warnings(told.robot, each) for each in found]
    assert words[0] == words[1]
    assert " mm RMS against" in words[0][0]


@pytest.mark.parametrize("kind", ["point", "orientation", "distance"])
def test_fewer_kinds_are_weighed_by_their_own_noise(told: Told, kind: str) -> None:
    """Test poses of one kind alone have the outliers and distances that it has beside the others."""
    whole, alone = with_test(told.found, told.test), with_test(told.found, only(told.test, (kind,)))
    assert whole.test is not None
    assert alone.test is not None
    own = {name: row.mean for name, row in alone.test[1].items()}
    assert own == pytest.approx({name: whole.test[1][name].mean for name in own})
    assert len(alone.test_outliers) == (3 if kind == "distance" else 0)
    assert bool(coverage_warnings(told.robot, alone)) == (kind == "distance")
    assert [each.sensor.name for each in residuals_of(alone) if each.label == "test"] == [kind]


def test_a_further_kind_is_measured_where_it_can_be(told: Told) -> None:
    """A wire at test poses alone is placed by them and weighed by its usual noise; the other kinds stay as they are without it."""
    found = fit(told.robot, only(told.fitted, ("point", "orientation")))
    more, less = with_test(found, told.test), with_test(found, only(told.test, ("point", "orientation")))
    assert more.test is not None
    assert less.test is not None
    assert more.test[1]["tool0"].mean == pytest.approx(less.test[1]["tool0"].mean)
    assert more.test[1]["tool0 distance"].mean < 4
    sigma = next(each.sigma for each in residuals_of(more) if each.label == "test" and each.sensor.name == "distance")
    assert sigma[0, 0] == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("fitted", "words"),
    [
        ("point", "have orientations of tool0, but the fitted ones do not tell how tool0 is turned on its link"),
        ("distance", "have points of tool0, but the fitted ones do not tell where the measuring frame stands"),
    ],
)
def test_a_further_kind_that_nothing_places_is_refused(told: Told, fitted: str, words: str) -> None:
    """Readings that depend on a placement of which the fitted poses say nothing are refused by name."""
    found = fit(told.robot, only(told.fitted, (fitted,)))
    with pytest.raises(UsageError, match=words):
        with_test(found, told.test)
