# ruff: noqa: E501
"""Twenty programs as people and controllers write them: blanks, comments, continued lines, exponents, arrays, frames given late."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from tests.deploy.test_programs import between
from urdfcal.base.geometry import DEG, MM
from urdfcal.deploy.programs.languages import read_program
from urdfcal.robot.robot import load_robot
from urdfcal.robot.way import Way

E = "[9E9,9E9,9E+09,9E9,9E9,9E9]"
TURNS, PLACES = np.array([DEG] * 6), np.array([MM] * 3 + [DEG] * 3)
LEFT_FLANGE, LEFT_BASE = "the flange is taken", "the robot's own base is taken"


class Case(NamedTuple):
    """A program: its targets in the language's own numbers with the sizes of their units, what is said of it, frames stated, z of tools."""

    name: str
    text: str
    targets: list[tuple[int, list[float]]]
    units: np.ndarray = np.ones(6)
    said: tuple[str, ...] = ()
    frames: tuple[str, ...] = ()
    tools: tuple[float, ...] = ()


def robtarget(x: str, y: str, z: str) -> str:
    return f"[[{x},{y},{z}],[1,0,0,0],[0,0,0,0],{E}]"


CASES = {
    "keywords": Case(
        "a.script",
        "def f():\n  movej( q = [0,-1.57,1E0,-.5,+2,1e-1] , a=1 )\n  movel(pose=p[.1,.2,.3,0,0,1.5e-2],v=0.1)\nend\n",
        [(2, [0, -1.57, 1, -0.5, 2, 0.1]), (3, [0.1, 0.2, 0.3, 0, 0, 0.015])],
        said=(LEFT_FLANGE,),
    ),
    "tab_and_cr": Case(
        "a.script", "\tset_tcp( p[0,0,.05,0,0,0] )\r\n\tmovel(p[\t1 ,\r\n 2,3 , 0,0, 0])\r\n", [(2, [1, 2, 3, 0, 0, 0])], tools=(0.05,)
    ),
    "named_twice": Case(
        "a.script",
        "set_tcp(p[0,0,0,0,0,0])\nglobal a = p[1,0,0,0,0,0]\nlocal a= p[2,0,0,0,0,0] # p[9,9,9,9,9,9]\nmovel(a, a=1.2)\n",
        [(2, [1, 0, 0, 0, 0, 0]), (3, [2, 0, 0, 0, 0, 0])],
    ),
    "changed": Case(
        "a.script",
        "x=p[1,0,0,0,0,0]\nmovel(x)\nx[2] = x[2] + 0.1\nmovel(x)\n",
        [(1, [1, 0, 0, 0, 0, 0])],
        said=("x is changed as the program runs", LEFT_FLANGE),
    ),
    "stated_tcp": Case("a.urscript", "movel(p[1,2,3,0,0,0])", [(1, [1, 2, 3, 0, 0, 0])], frames=("tcp=0,0,0.12,0,0,0",), tools=(0.12,)),
    "arrays": Case(
        "a.mod",
        f"CONST robtarget p{{2}}:=[{robtarget('1', '2.0', '-3E+00')},\r\n  {robtarget('4', '5', '6')}];\r\n"
        f"VAR num n{{2,6}}:=[[1,2,3,4,5,6],[1,2,3,4,5,6]];\r\nMoveL p{{i}},v100,z10,tool0\\TLoad:=load1;\r\n",
        [(1, [1, 2, -3, 1, 0, 0, 0]), (2, [4, 5, 6, 1, 0, 0, 0])],
        np.array([MM] * 3 + [1.0] * 4),
    ),
    "given_later": Case(
        "a.mod",
        f"VAR robtarget q;\nPROC m()\n q :=\n  {robtarget('7', '8', '9')}; ! [[1,2,3],[1,0,0,0]]\n q.trans.z:=12;\n"
        " movej q,v100,z5,tool0;\n movement q;\nENDPROC",
        [(4, [7, 8, 9, 1, 0, 0, 0])],
        np.array([MM] * 3 + [1.0] * 4),
        ("q.trans.z is changed",),
    ),
    "joint_array": Case(
        "a.modx",
        f"CONST jointtarget j{{2}}:=[[[0,-1,2,3,4,5],{E}],[[1e1,1,2,3,4,6],{E}]];\nMoveAbsJ j{{1}},v1,fine,grip;",
        [(1, [0, -1, 2, 3, 4, 5]), (1, [10, 1, 2, 3, 4, 6])],
        TURNS,
    ),
    "other_moves": Case(
        "a.prg",
        'PERS tooldata g:=[TRUE,[[0,0,20],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];\nTPWrite "MoveL p1,v1,z1,g;";\n'
        f"TriggL {robtarget('1', '2', '3')},v100,t1,z5,g;\nMoveLDO {robtarget('4', '5', '6')},v1,z1,g,do1,1;\nArcL {robtarget('7', '8', '9')},v1,s,w\\Weave:=x,fine,g;",
        [(3, [1, 2, 3, 1, 0, 0, 0]), (4, [4, 5, 6, 1, 0, 0, 0]), (5, [7, 8, 9, 1, 0, 0, 0])],
        np.array([MM] * 3 + [1.0] * 4),
        tools=(0.02, 0.02, 0.02),
    ),
    "optional": Case(
        "a.mod",
        f"MoveL \\Conc , {robtarget('1', '2', '3')} \\ID:=5 , v100 \\V:=50, z10, grip \\WObj:= Table \\Corr ;",
        [(1, [1, 2, 3, 1, 0, 0, 0])],
        np.array([MM] * 3 + [1.0] * 4),
        frames=("grip=0,0,200,1,0,0,0", "table=500,0,0,1,0,0,0"),
        tools=(0.2,),
    ),
    "held_by_name": Case(
        "a.src",
        "DECL FRAME T\n$BASE=$NULLFRAME\n$TOOL=TOOL_DATA[2] ; {X 9}\nT={X 5,Y 0,Z 0,A 0,B 0,C 0}\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}\n$BASE=T\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0} C_DIS\n",
        [(5, [1, 2, 3, 0, 0, 0]), (7, [1, 2, 3, 0, 0, 0])],
        PLACES,
        frames=("TOOL_DATA[2]=0,0,222,0,0,0",),
        tools=(0.222, 0.222),
    ),
    "bas": Case(
        "a.src",
        "BAS (#BASE, 0)\nBAS(#TOOL,1)\nCIRC {X 1,Y 2,Z 3,A 0,B 0,C 0} , { X 4 , Y 2,Z 3,A 0,B 0,C 0, S 2,T 3}, CA 360\n$H_POS={A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}\n",
        [(3, [1, 2, 3, 0, 0, 0]), (3, [4, 2, 3, 0, 0, 0])],
        PLACES,
        ("$H_POS is the controller's own",),
        ("TOOL_DATA[1]=0,0,111,0,0,0",),
        (0.111, 0.111),
    ),
    "chained": Case(
        "a.src",
        "$TOOL=$NULLFRAME\n$BASE=$WORLD\nLIN {X 1e2,Y -.2E+1,Z 3,A 0,B 0,C 0}\nLIN XP1:{X 0,Y 0,Z 50,A 0,B 0,C 0}\nSLIN_REL{Z 10}\n",
        [(3, [100, -2, 3, 0, 0, 0])],
        PLACES,
        ("':{...}' goes from a corrected target", "SLIN_REL goes from"),
    ),
    "typed": Case(
        "a.dat",
        "DEFDAT A\nDECL E6POS XP1={E6POS: X 1,Y 2,Z 3,A 4,B 5,C 6,S 6,T 27,E1 0}\nDECL FRAME F={FRAME: X 9,Y 0,Z 0,A 0,B 0,C 0}\n"
        "DECL FDAT FP1={TOOL_NO 0,BASE_NO 0,IPO_FRAME #BASE,POINT2[] \" \"}\nDECL E6AXIS XHOME={E6AXIS: A1 0,A2 -90.5,A3 90,A4 0,A5 0,A6 0}\nENDDAT\n",
        [(2, [1, 2, 3, 4, 5, 6]), (5, [0, -90.5, 90, 0, 0, 0])],
        PLACES,
    ),
    "untold": Case(
        "a.src", "PTP {X 1,Y 2,Z 3,A 0,B 0,C 0}\nPTP{X 4,Y 5,Z 6,A 0,B 0,C 0}", [(1, [1, 2, 3, 0, 0, 0]), (2, [4, 5, 6, 0, 0, 0])], PLACES,
        (LEFT_BASE, LEFT_FLANGE),
    ),
    "fold": Case(
        "a.src",
        "&ACCESS RVP\n;FOLD PTP P1 Vel=100 % PDAT1 Tool[1] ;%{PE}%R {X 1,Y 2}\nDEF a()\nPTP\t{ A1\t-10.5 ,A2 -90,A3 9.0E1,A4 +0,A5 0,A6 1,E1 0,E2 0 }\nEND",
        [(4, [-10.5, -90, 90, 0, 0, 1])],
        TURNS,
    ),
    "steps": Case(
        "a.ls",
        "/MN\n   1:L P[2] 10mm/sec FINE INC   ;\n   2:L P[1] 10mm/sec CNT100 Offset,PR[2] ;\n   3:J PR[3] 100% FINE ;\n   4:  PR[3]=P[1] ;\n/POS\n"
        "P[1]{\n GP1:\n UF : 0, UT : 0, CONFIG : 'N U T, 0, 0, 0',\n X = 5.0 mm,Y =-.5 mm,Z=6 mm,\n W = 1 deg,P = 2 deg,R =    -3.000 deg\n};\n"
        "P[2]{\n GP1:\n UF : 0, UT : 0,\n X = 5.0 mm,Y =-.5 mm,Z=6 mm,\n W = 1 deg,P = 2 deg,R = 3 deg\n};\n/END\n",
        [(7, [5, -0.5, 6, 1, 2, -3])],
        PLACES,
        ("P[2] is a step", "an offset by PR[2]", "goes to PR[3]"),
    ),
    "turned": Case(
        "a.ls",
        "".join(
            f"{'/POS' if n == 1 else ''}\nP[{n}:\"a b\"]{{\n GP1:\n UF : 0, UT : 0, CONFIG : '{c} U T, 0, 0, 0',\n X = {n} mm,Y =0 mm,Z=6 mm,\n W = 1 deg,P = 2 deg,R = 3 deg\n}};"
            for n, c in ((1, "N"), (2, "F"))
        ),
        [(2, [1, 0, 6, 1, 2, 3]), (8, [2, 0, 6, 1, 2, 3])],
        PLACES,
        ("P[2] is in the configuration F U T",),
    ),
    "two_groups": Case(
        "a.LS",
        "/POS\r\nP[7]{\r\n   GP1:\r\n\tUF : 0, UT : 3,\r\n\tJ1=   -1.0E1 deg,\tJ2=    20 deg,\tJ3=   -30.000 deg,\r\n\tJ4=     0.000 deg,\tJ5=   -45.000 deg,\tJ6=     1 deg,\r\n"
        "\tE1=  0.000  mm\r\n};\r\n/END",
        [(2, [-10, 20, -30, 0, -45, 1])],
        TURNS,
    ),
    "spread": Case(
        "a.ls",
        "/PROG A\n/MN\n 1: ! P[1]{ X = 9 mm } ;\n/POS\nP[1]\n{\nGP1:\nUF:0,UT:1,CONFIG:'N U T,0,0,0',\nX=1mm,Y=2mm,Z=3mm,W=0deg,P=0deg,R=.5deg\n}\n;\n",
        [(6, [1, 2, 3, 0, 0, 0.5])],
        PLACES,
        frames=("UT1=0,0,70,0,0,0",),
        tools=(0.07,),
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def ur5(example_robots: Path) -> Way:
    """A UR5 up to its flange."""
    return Way.between(load_robot(example_robots / "ur_description" / "urdf" / "ur5_robot.urdf"), "tool0")


@pytest.mark.parametrize("name", CASES)
def test_numbers_are_right_and_all_other_bytes_stay(name: str, ur5: Way, tmp_path: Path) -> None:
    """Every target and no other number, in the frames that hold there; other numbers are read back as themselves, with the same between."""
    case = CASES[name]
    place = tmp_path / case.name
    place.write_bytes(case.text.encode())
    file = read_program(place, ur5, case.frames)
    assert [target.line for target in file.targets] == [line for line, _ in case.targets]
    for target, (_, numbers) in zip(file.targets, case.targets, strict=True):
        units = TURNS if target.orientation is None and case.name.lower() not in ("a.script", "a.urscript") else case.units
        np.testing.assert_allclose(target.values, numbers * units, atol=1e-12)
    assert len(file.said) == len(case.said)
    assert all(word in said for word, said in zip(sorted(case.said), sorted(file.said, key=lambda said: _found(said, case)), strict=True))
    np.testing.assert_allclose([target.T_flange_tcp[2, 3] for target in file.targets][: len(case.tools)], case.tools, atol=1e-12)
    assert file.with_numbers([target.values for target in file.targets]) == case.text.encode()
    other = [target.values + 1e-4 * np.arange(1, len(target.values) + 1) for target in file.targets]
    place.write_bytes(file.with_numbers(other))
    again = read_program(place, ur5, case.frames)
    for target, values in zip(again.targets, other, strict=True):
        np.testing.assert_allclose(target.values, values, atol=1e-8)
    assert between(again) == between(file)


def _found(said: str, case: Case) -> str:
    return next((word for word in case.said if word in said), "")


def test_frames_that_are_not_numbers_are_refused_where_they_are_used(ur5: Way, tmp_path: Path) -> None:
    """A base that is worked out, one that is given numbers twice, and a target before a `:`."""
    for text, word in (
        ("$BASE=BASE_DATA[1]:{X 1,Y 0,Z 0,A 0,B 0,C 0}\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}", "a.src:2: is told with BASE_DATA[1]:"),
        ("LIN {X 1,Y 2,Z 3,A 0,B 0,C 0}:XP1", "a.src:1: is told with ':'"),
        (
            "T={FRAME:X 1,Y 0,Z 0,A 0,B 0,C 0}\nT={FRAME:X 2,Y 0,Z 0,A 0,B 0,C 0}\n$BASE=T\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}",
            "a.src:4: is told with T, which is given numbers twice",
        ),
        ("$BASE=T\nLIN {X 1,Y 2,Z 3,A 0,B 0,C 0}", "a.src:2: is told with T, whose numbers do not stand"),
    ):
        (tmp_path / "a.src").write_text(text)
        with pytest.raises(Exception, match=r"a\.src") as refused:
            read_program(tmp_path / "a.src", ur5)
        assert word in str(refused.value)
