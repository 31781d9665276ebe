"""Robot programs: which numbers are targets, what they mean, and that nothing else is touched."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from urdfcal.base.errors import InputError, UrdfcalError, UsageError
from urdfcal.base.geometry import DEG, MM
from urdfcal.deploy.orientations import KUKA_ANGLES, QUATERNION_W_FIRST, ROTATION_VECTOR
from urdfcal.deploy.programs.languages import read_program
from urdfcal.deploy.targets import TargetFile, corrected
from urdfcal.robot.robot import load_robot
from urdfcal.robot.way import Way

URSCRIPT = r"""def prog():  # p[9,9,9,9,9,9] in a comment
  textmsg("movej([1,2,3,4,5,6])")
  set_tcp(p[0, 0, 0.1, 0,0,0])
  home = [ 0.1, -1.2 ,1.3,-0.4,
           1.5e+0,.6 ]
	movej(home, a=1.4, v=1.05)
  movel(p[ -4.0e-1,0.2,  +.3,0,3.14,0 ], a = 1)
  via = p[.1,.2,.3,d2r(10),0,0]
  movec( via,p[1,2,3,0,0,1],r=0)
  movej( get_inverse_kin( p[.2,.2,.2,0,0,0] ) )
  if x[1] > -2: y = [1, 2] end
end
"""
RAPID = r"""MODULE M ! robtarget q:=[[9,9,9],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
 PERS tooldata gun:=[TRUE,[[0,0,100.0],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
 PERS wobjdata Fix := [FALSE,TRUE,"",[[500,0,0],[1,0,0,0]],[[0,10,0],[1,0,0,0]]];
  CONST robtarget p10:=[[ 500.0 , -1E+2,300],
     [0,1, 0 ,0],[0,-1,0,0],[9E9,9E9,9E9,9E9,9E+09,9E9]];
 CONST jointtarget j1:=[[0,-10.5,20,30,4e1,50],[9E9,9E9,9E9,9E9,9E9,9E9]];
 CONST robtarget unused:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
 PROC main()
  MoveAbsJ j1\NoEOffs,v100,fine,tool0;
  movel P10,v100,z10,gun\WObj:=Fix;
  MoveJ [[1,2,3],[1,0,0,0],[0,0,0,0],[0,9E9,9E9,9E9,9E9,9E9]], v1000, fine, tool0;
  MoveL Offs(p10,0,0,50),v100,fine,gun \WObj := Fix;
 ENDPROC
ENDMODULE
"""
KRL = """&ACCESS RVP
DEF prog( )
;FOLD X {X 9,Y 9,Z 9,A 0,B 0,C 0}
$BASE={X 100,Y 0,Z 0,A 90,B 0,C 0}
$TOOL = {X 0.0,Y 0,Z 1.5E2,A 0.0,B 0,C 0}
PTP {A1 0,A2 -90.0,A3 90,A4 0,A5 +45,A6 0,E1 0}
LIN { X 500.25, Y -10 ,Z 600,A 10,B 20,C -30,S 2,T 35}
PTP_REL {A1 10}
DECL E6POS XP1={X 1.0,Y 2.0,Z 3.0,A 4.0,B 5.0,C 6.0,S 6,T 27,E1 0.0,E2 0.0}
DECL FDAT FP1={TOOL_NO 1,BASE_NO 0,IPO_FRAME #BASE}
TOOL_DATA[1]={X 0,Y 0,Z 200,A 0,B 0,C 0}
DECL E6AXIS XP2={A1 1.0,A2 2.0,A3 3.0,A4 4.0,A5 5.0,A6 6.0,E1 0.0}
END
"""
FANUC = """/PROG  TEST
/ATTR
/MN
   1:  !P[1] X = 9.0 mm ;
   2:J P[1:"home"] 100% FINE    ;
/POS
P[1:"home"]{
   GP1:
\tUF : 0, UT : 1,\t\tCONFIG : 'N U T, 0, 0, 0',
\tX =   500.000  mm,\tY =     -.500  mm,\tZ =   600.000  mm,
\tW =   180.000 deg,\tP =     0.000 deg,\tR =    -90.000 deg
};
P[2]{
   GP1:
\tUF : 0, UT : 1,\t
\tJ1=   -10.500 deg,\tJ2=    20.000 deg,\tJ3=   -30.000 deg,
\tJ4=     0.000 deg,\tJ5=   -45.000 deg,\tJ6=     1.000 deg
};
/END
"""
J = [0.1, -1.2, 1.3, -0.4, 1.5, 0.6]
EXPECTED = {
    "a.script": (
        URSCRIPT,
        [
            (4, J),
            (7, [-0.4, 0.2, 0.3, 0, 3.14, 0]),
            (8, [0.1, 0.2, 0.3, 10 * DEG, 0, 0]),
            (9, [1, 2, 3, 0, 0, 1]),
            (10, [0.2] * 3 + [0] * 3),
        ],
    ),
    "a.mod": (
        RAPID,
        [
            (4, [0.5, -0.1, 0.3, 0, 1, 0, 0]),
            (6, [0, -10.5 * DEG, 20 * DEG, 30 * DEG, 40 * DEG, 50 * DEG]),
            (11, [1 * MM, 2 * MM, 3 * MM, 1, 0, 0, 0]),
        ],
    ),
    "a.src": (
        KRL,
        [
            (6, [0, -90 * DEG, 90 * DEG, 0, 45 * DEG, 0]),
            (7, [0.50025, -0.01, 0.6, 10 * DEG, 20 * DEG, -30 * DEG]),
            (9, [1 * MM, 2 * MM, 3 * MM, 4 * DEG, 5 * DEG, 6 * DEG]),
            (12, [number * DEG for number in range(1, 7)]),
        ],
    ),
    "a.ls": (
        FANUC,
        [
            (7, [0.5, -0.0005, 0.6, np.pi, 0, -np.pi / 2]),
            (13, [-10.5 * DEG, 20 * DEG, -30 * DEG, 0, -45 * DEG, 1 * DEG]),
        ],
    ),
}
FRAMES = {"a.ls": ["UT1=0,0,100,0,0,0"]}


@pytest.fixture(scope="module")
def ur5(example_robots: Path) -> Way:
    """A UR5 up to its flange."""
    return Way.between(load_robot(example_robots / "ur_description" / "urdf" / "ur5_robot.urdf"), "tool0")


def read(name: str, text: str, way: Way, folder: Path, encoding: str = "utf-8") -> TargetFile:
    """A program with this text."""
    path = folder / name
    path.write_bytes(text.encode(encoding))
    return read_program(path, way, FRAMES.get(name, ()))


def between(file: TargetFile) -> list[str]:
    """The text before, between and behind the numbers of the targets."""
    pieces, end = [], 0
    for number in sorted((each for target in file.targets for each in target.numbers), key=lambda each: each.start):
        pieces.append(file.text[end : number.start])
        end = number.end
    return [*pieces, file.text[end:]]


@pytest.mark.parametrize("name", EXPECTED)
def test_targets_are_found_and_mean_what_they_say(name: str, ur5: Way, tmp_path: Path) -> None:
    """Every target and no other number, by line and in SI, whatever comments, strings, blanks and broken lines stand between."""
    text, expected = EXPECTED[name]
    found = read(name, text, ur5, tmp_path).targets
    assert [target.line for target in found] == [line for line, _ in expected]
    for target, (_, numbers) in zip(found, expected, strict=True):
        assert np.allclose(target.values, numbers, atol=1e-12)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1"])
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
@pytest.mark.parametrize("name", EXPECTED)
def test_every_other_byte_stays(name: str, ends: str, encoding: str, ur5: Way, tmp_path: Path) -> None:
    """The same numbers give the same bytes; other numbers are read back as themselves, with the same text between."""
    text = EXPECTED[name][0].replace("\n", ends).replace("prog", "prüf").replace("main", "prüf")
    file = read(name, text, ur5, tmp_path, encoding)
    whole = file.path.read_bytes()
    values = [target.values for target in file.targets]
    assert file.with_numbers(values) == whole
    other = [own + 1e-4 * np.arange(1, len(own) + 1) for own in values]
    file.path.write_bytes(file.with_numbers(other))
    again = read_program(file.path, ur5, FRAMES.get(name, ()))
    for target, own in zip(again.targets, other, strict=True):
        assert np.allclose(target.values, own, atol=1e-8)
    assert between(again) == between(file)


def test_frames_and_tools_are_those_of_the_program(ur5: Way, tmp_path: Path) -> None:
    """A placement of the tool's link is frame, told placement, and the tool's point undone, by each language's own words."""
    tcp = np.eye(4)
    tcp[2, 3] = 0.1
    urscript = read("a.script", URSCRIPT, ur5, tmp_path).targets[1]
    assert np.allclose(urscript.placement() @ tcp, ROTATION_VECTOR.frame([-0.4, 0.2, 0.3, 0, 3.14, 0]))
    rapid = read("a.mod", RAPID, ur5, tmp_path).targets
    assert np.allclose((rapid[0].placement() @ tcp)[:3, 3], [1.0, -0.09, 0.3])
    assert np.allclose(rapid[2].placement(), QUATERNION_W_FIRST.frame([1e-3, 2e-3, 3e-3, 1, 0, 0, 0]))
    krl = read("a.src", KRL, ur5, tmp_path).targets
    base = KUKA_ANGLES.frame([0.1, 0, 0, np.pi / 2, 0, 0])
    told = KUKA_ANGLES.frame([0.50025, -0.01, 0.6, 10 * DEG, 20 * DEG, -30 * DEG])
    tool = KUKA_ANGLES.frame([0, 0, 0.15, 0, 0, 0])
    assert np.allclose(krl[1].placement(), base @ told @ np.linalg.inv(tool))
    assert np.allclose(krl[2].T_flange_tcp[2, 3], 0.2)
    assert np.allclose(krl[2].T_base_frame, np.eye(4))
    assert np.allclose(read("a.ls", FANUC, ur5, tmp_path).targets[0].T_flange_tcp, tcp)


@pytest.mark.parametrize(
    ("name", "text", "line", "word"),
    [
        ("a.script", "movej(p[0,0,0,0,0,0])\nmovel(pose_add(a, b))", 2, "worked out as the program runs"),
        ("a.script", "a = p[0,0,0,0,0,x]\nmovel(a)", 1, "worked out as the program runs"),
        ("a.script", "set_tcp(tool)\nmovel(p[0,0,0,0,0,0])", 2, "the point that set_tcp names"),
        ("a.script", "a=p[0,0,0,0,0,0]\nmovel(a)\nset_tcp(p[0,0,1,0,0,0])\nmovel(a)", 1, "with two tools"),
        ("a.mod", RAPID.replace("gun:=[TRUE", "torch:=[TRUE"), 4, "is gone to with 'gun', whose numbers do not stand"),
        (
            "a.mod",
            RAPID.replace("fine,gun \\WObj := Fix", "fine,tool0").replace("Offs(p10,0,0,50)", "p10"),
            4,
            "give each a target of its own",
        ),
        ("a.mod", RAPID.replace("tooldata gun:=[TRUE", "tooldata gun:=[FALSE"), 4, "whose numbers do not stand"),
        ("a.src", KRL.replace("TOOL_NO 1", "TOOL_NO 3"), 9, "is told with TOOL_DATA[3]"),
        ("a.src", "LIN {X 1,Y 2}", 1, "is not whole"),
        ("a.src", "PTP {A1 a,A2 0,A3 0,A4 0,A5 0,A6 0}", 1, "A1 is 'a'"),
        ("a.ls", FANUC.replace("UT : 1", "UT : 2"), 7, "is told with UT 2"),
        ("a.ls", FANUC.replace("500.000", "********"), 7, "has no number for X"),
        ("a.ls", FANUC.replace("500.000  mm", "500.000  deg"), 10, "is in deg"),
    ],
)
def test_what_cannot_be_resolved_is_refused(name: str, text: str, line: int, word: str, ur5: Way, tmp_path: Path) -> None:
    """A target that is worked out, in two frames, or in one that nobody knows, is named by its line."""
    with pytest.raises(InputError) as refused:
        read(name, text, ur5, tmp_path)
    assert word in str(refused.value)
    assert f"{name}:{line}:" in str(refused.value)


def test_what_is_no_program_is_refused(ur5: Way, tmp_path: Path) -> None:
    """A file that is not there, and a device under a program's name, are refused in words."""
    with pytest.raises(InputError, match=r"gone.script: cannot be read"):
        read_program(tmp_path / "gone.script", ur5)
    (tmp_path / "zero.src").symlink_to("/dev/zero")
    with pytest.raises(InputError, match=r"zero.src: is a device, expected a regular file"):
        read_program(tmp_path / "zero.src", ur5)


def test_what_is_left_is_said(ur5: Way, tmp_path: Path) -> None:
    """Offsets from a target, relative moves, and targets that no move goes to."""
    said = read("a.mod", RAPID, ur5, tmp_path).said
    assert len(said) == 2
    assert "a.mod:12: Offs goes from a corrected target on by nominal geometry" in said[0]
    assert "a.mod:7: no move of this file goes to this target" in said[1]
    assert "a.src:8: PTP_REL goes from a corrected target" in read("a.src", KRL, ur5, tmp_path).said[0]
    with pytest.raises(UsageError, match="has no targets that are numbers"):
        read("a.src", "DEF p()\nEND", ur5, tmp_path)
    (tmp_path / "a.dat").touch()
    with pytest.raises(UsageError, match=r"its points stand in .*a\.dat"):
        read("a.src", "DEF p()\nPTP XP1\nEND", ur5, tmp_path)


def test_the_configuration_is_the_programs_own(ur5: Way, tmp_path: Path) -> None:
    """Quadrants of RAPID's confdata and signs of KRL's turn choose among the ways to reach a placement."""
    for q in np.array([[0.4, -1.2, 1.4, -0.6, 1.2, 0.3], [0.4, -0.4, -1.4, 2.0, -1.2, -2.0]]):
        placed = ur5.placements(q[None])[0]
        place = ",".join(f"{value:.6f}" for value in placed[:3, 3] / MM)
        w = ",".join(f"{value:.9f}" for value in QUATERNION_W_FIRST.numbers(placed[:3, :3], np.array([1.0, 0, 0, 0])))
        conf = ",".join(str(int(np.floor(angle / (90 * DEG)))) for angle in (q[0], q[3], q[5]))
        rapid = f"MoveL [[{place}],[{w}],[{conf},0],[9E9,9E9,9E9,9E9,9E9,9E9]],v1,fine,tool0;"
        found = corrected(read("a.mod", rapid, ur5, tmp_path), ur5, ur5.placements)
        assert np.allclose(np.floor((found[0].q[[0, 3, 5]] + 1e-9) / (90 * DEG)), np.floor(q[[0, 3, 5]] / (90 * DEG)))
        x, y, z = placed[:3, 3] / MM
        a, b, c = KUKA_ANGLES.numbers(placed[:3, :3], np.zeros(3)) / DEG
        turn = sum(1 << axis for axis in range(6) if q[axis] < 0)
        krl = f"PTP {{X {x:.6f},Y {y:.6f},Z {z:.6f},A {a:.7f},B {b:.7f},C {c:.7f},S 2,T {turn}}}"
        found = corrected(read("a.src", krl, ur5, tmp_path), ur5, ur5.placements)
        assert (np.sign(found[0].q) == np.sign(q)).all()


def test_broken_programs_end_in_a_line(ur5: Way, tmp_path: Path) -> None:
    """Whatever is put in, taken out or changed: targets, or an error that names the file."""
    rng = np.random.default_rng(7)
    for name, (text, _) in EXPECTED.items():
        for _ in range(60):
            broken, at = text, int(rng.integers(len(text)))
            broken = (
                broken[:at]
                + str(rng.choice(["", "[", "]", "{", "}", ",", "(", ")", '"', "\\", "=", "1e999", "nan"]))
                + broken[at + int(rng.integers(4)) :]
            )
            try:
                file = read(name, broken, ur5, tmp_path)
            except UrdfcalError as error:
                assert name in str(error)  # noqa: PT017
                continue
            assert file.with_numbers([target.values for target in file.targets])
