"""What drives a robot through planned poses says the same in every form, read by another road."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from urdfcal.base.errors import UsageError
from urdfcal.deploy.programs.scan import Program, tokens_of
from urdfcal.deploy.programs.urscript import COMMENT, QUOTES, read
from urdfcal.output.drives import Drive, degrees_csv, drive_of, require_form, trajectory_yaml, urscript
from urdfcal.output.text.poses import plan_csv
from urdfcal.planning.plan import PosePlan, plan_poses
from urdfcal.planning.tour import speeds_of, toured
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.robot import Robot


@pytest.fixture(scope="module")
def plan(robots: dict[str, Robot]) -> PosePlan:
    """Of a UR5, each pose to be visited from both sides."""
    return plan_poses(robots["ur5"], candidates=60, n=6, sensors=["point:tool0"], both_sides=True)


@pytest.fixture(scope="module", params=[False, True], ids=["any", "both"])
def drive(plan: PosePlan, request: pytest.FixtureRequest) -> Drive:
    """The tour, from any side or from both."""
    tour = toured(plan.q, plan.robot, np.zeros(6), None, plan.q)
    tour = replace(tour, vias={2: np.full((1, 6), 0.25)})
    return drive_of(plan, tour, both_sides=request.param, speed=0.5, pause=1.5, made_of="0" * 64)


def test_a_trajectory_has_the_stations_and_their_times(drive: Drive) -> None:
    """As trajectory_msgs has it: each point as long after the one before as its slowest joint takes at half speed; poses stand still."""
    text = trajectory_yaml(drive).decode()
    told = yaml.safe_load(text)
    assert set(told) == {"joint_names", "points"}
    assert told["joint_names"] == list(drive.joints)
    q = np.array([point["positions"] for point in told["points"]])
    times = np.array([point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"] for point in told["points"]])
    taken = (np.abs(np.diff(q, axis=0)) / (0.5 * speeds_of(drive.robot))).max(axis=1)
    still = taken == 0
    assert still.sum() == sum(map(bool, drive.names))
    assert np.allclose(np.diff(times), np.where(still, 1.5, taken), atol=1e-5)
    assert np.allclose(q[np.append(True, ~still)], drive.q, atol=1e-6)
    for name, index in re.findall(r"(p\d\d[ab]?) (\d+)", text.partition("joint_names")[0]):
        assert np.allclose(q[int(index)], drive.q[drive.names.index(name)], atol=1e-6)


def test_a_leg_without_a_way_is_never_driven(plan: PosePlan) -> None:
    """Of a tour in parts the longest is driven, its poses called as in the table; no two stations are the ends of a blocked leg."""
    tour = replace(toured(plan.q, plan.robot, np.zeros(6), None, plan.q), blocked=(1, 4), vias={3: np.full((1, 6), 0.25)})
    drive = drive_of(plan, tour, both_sides=False, speed=0.5, pause=0.0, made_of="0" * 64)
    assert drive.names == ("p03", "p04", "", "p05")
    assert np.allclose(drive.q, [*plan.q[tour.order][2:4], np.full(6, 0.25), plan.q[tour.order][4]])


def test_urscript_is_read_back(drive: Drive) -> None:
    """By the reader of programs: the positions of every station, in the order of the joints."""
    text = urscript(drive).decode()
    found = read(Program(Path("t.script"), text, "utf-8", tokens_of(text, COMMENT, QUOTES), 6, {}))
    assert np.allclose([[number.value for number in target.numbers] for target in found.targets], drive.q, atol=1e-6)
    assert re.findall(r'textmsg\("(.+?)"\)', text) == [name for name in drive.names if name]
    assert text.count("sleep(1.5)") == sum(map(bool, drive.names))


def test_the_table_is_in_degrees(drive: Drive) -> None:
    """A row a station; what is no pose is a via."""
    rows = list(csv.DictReader(line for line in degrees_csv(drive).decode().splitlines() if not line.startswith("#")))
    assert np.allclose(np.radians([[float(row[f"{name} [deg]"]) for name in drive.joints] for row in rows]), drive.q, atol=1e-7)
    assert [row["pose"] for row in rows] == [name or "via" for name in drive.names]


def test_both_sides_are_both_sides(plan: PosePlan, drive: Drive) -> None:
    """Each pose is come to by all joints rising, then by all falling, and never leaves the limits; the file says which way they came."""
    low, high = joint_limits(plan.robot)
    assert (drive.q >= low).all()
    assert (drive.q <= high).all()
    if len([name for name in drive.names if name]) == 6:
        return
    for index, name in enumerate(drive.names):
        if name:
            step = drive.q[index] - drive.q[index - 1]
            assert (step > 0).all() if name.endswith("a") else (step < 0).all()
    tour = toured(plan.q, plan.robot, np.zeros(6), None, plan.q)
    lines = plan_csv(plan, tour, 5, "0" * 64, both_sides=True).decode().splitlines()
    lines = [line for line in lines if not line.startswith("#")]
    rows = list(csv.DictReader(lines))
    assert [row["pose"] for row in rows] == [name for name in drive.names if name]
    assert all(row[f"{name}.approach"] == ("1" if row["pose"].endswith("a") else "-1") for row in rows for name in plan.joints)
    assert [row["set"] for row in rows].count("test") == 2


def test_what_urscript_cannot_move_is_refused(robots: dict[str, Robot], drive: Drive) -> None:
    """Seven joints, and endings of no form."""
    panda = plan_poses(robots["panda"], candidates=20, n=2, sensors=["point:panda_link8"]).robot
    with pytest.raises(UsageError, match="six joints that turn, and panda has 7"):
        require_form(Path("t.script"), panda)
    with pytest.raises(UsageError, match=r"ends in '\.xml', expected \.yaml"):
        require_form(Path("t.xml"), panda)
    require_form(Path("t.script"), drive.robot)
