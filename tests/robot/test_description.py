"""What a URDF or xacro file becomes before anything looks at its joints."""

from __future__ import annotations

import os
import resource
import sys
from pathlib import Path

import pytest

from tests.support.small_robot import URDF, XACRO
from urdfcal.base.errors import RobotError
from urdfcal.robot.description import Description, read_description
from urdfcal.robot.robot import load_robot
from urdfcal.robot.xacro_child import XacroLimit, variants

HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'


def xacro(folder: Path, body: str, name: str = "r.xacro") -> Path:
    path = folder / name
    path.write_text(HEAD + body + "</robot>", "utf-8")
    return path


def test_a_plain_urdf_is_its_own_bytes(tmp_path: Path) -> None:
    """A URDF is taken byte for byte, also where a comment speaks of xacro."""
    text = (
        b"\xef\xbb\xbf" + URDF.replace("\n", "\r\n").replace("<link", "<!-- <xacro:include filename='old.xacro'/> -->\r\n<link", 1).encode()
    )
    (tmp_path / "small.urdf").write_bytes(text)
    description = read_description(tmp_path / "small.urdf")
    assert (description.text, description.expanded, description.stem) == (text, False, "small")


@pytest.mark.parametrize("name", ["small.xacro", "small.urdf.xacro", "small.urdf"])
def test_xacro_is_known_by_name_or_tag(tmp_path: Path, name: str) -> None:
    """A file is xacro by its ending, or by a xacro tag under any name; the expanded document says so itself."""
    (tmp_path / name).write_text(XACRO, "utf-8")
    description = read_description(tmp_path / name)
    assert description.expanded
    assert b"xacro:" not in description.text
    assert f"Expanded from {name} by xacro".encode() in description.text
    assert str(tmp_path / name) in description.label


STEMS = {
    "arm7.urdf.xacro": "arm7",
    "cell.left.urdf": "cell.left",
    "cell.left.xacro": "cell.left",
    "ur5e.v2.URDF": "ur5e.v2",
    "robot.xml": "robot",
    "robot": "robot",
    ".urdf": ".urdf",
    "v1.0": "v1.0",
}


@pytest.mark.parametrize("name", STEMS)
def test_the_stem_is_what_tells_files_apart(name: str) -> None:
    """Only the endings of descriptions are taken off a name, however many dots it has."""
    assert Description(Path("folder.x") / name, b"", expanded=False).stem == STEMS[name]


def test_xacro_of_a_plain_urdf_changes_no_joint(tmp_path: Path) -> None:
    """A plain URDF that is called .xacro expands to the same tree."""
    for name in ("small.urdf", "small.xacro"):
        (tmp_path / name).write_text(URDF, "utf-8")
    plain, expanded = load_robot(tmp_path / "small.urdf").tree, load_robot(tmp_path / "small.xacro").tree
    strip = [(j.name, j.type, j.parent, j.child, j.xyz, j.rpy, j.axis, j.lower, j.upper) for j in plain.joints.values()]
    assert strip == [(j.name, j.type, j.parent, j.child, j.xyz, j.rpy, j.axis, j.lower, j.upper) for j in expanded.joints.values()]


def test_a_dash_in_the_name_breaks_no_comment(tmp_path: Path) -> None:
    """A file name with dashes in a row still gives well-formed XML."""
    assert load_robot(_written(tmp_path / "a---b--.xacro", XACRO)).name == "small"


def test_xacro_arguments_reach_the_robot(tmp_path: Path) -> None:
    """A xacro argument replaces its default."""
    robot = load_robot(_written(tmp_path / "small.xacro", XACRO), xacro_args={"height": "0.75"})
    assert robot.tree.joints["turn"].xyz == (0.0, 0.0, 0.75)


def test_an_argument_that_no_file_knows_is_refused(tmp_path: Path) -> None:
    """A misspelt xacro argument is refused with the right name; on a plain URDF any is."""
    with pytest.raises(RobotError, match=r"small\.xacro: takes no xacro argument 'heigth'; did you mean 'height'"):
        read_description(_written(tmp_path / "small.xacro", XACRO), {"heigth": "1"})
    with pytest.raises(RobotError, match=r"small\.urdf: is a plain URDF and takes no xacro argument \(height\)"):
        read_description(_written(tmp_path / "small.urdf", URDF), {"height": "1"})


def test_an_argument_may_be_used_undeclared(tmp_path: Path) -> None:
    """An argument that is only used, in an included file, counts as known."""
    _written(tmp_path / "part.xacro", HEAD + '<link name="$(arg tip)"/></robot>')
    path = xacro(tmp_path, '<xacro:include filename="part.xacro"/>')
    assert b'<link name="t1"/>' in read_description(path, {"tip": "t1"}).text
    with pytest.raises(RobotError, match=r"r\.xacro: xacro: the argument 'tip' has no value and no default; .* --xacro-arg tip:=VALUE"):
        read_description(path)


@pytest.mark.parametrize("included", [False, True])
def test_a_file_of_macros_alone_is_said_to_be_one(tmp_path: Path, included: bool) -> None:
    """Macros that nobody calls make no robot; they are named, wherever they are defined."""
    macro = '<xacro:macro name="gripper" params="parent"><link name="palm"/></xacro:macro>'
    _written(tmp_path / "part.xacro", f"{HEAD}{macro}</robot>")
    path = xacro(tmp_path, '<xacro:include filename="part.xacro"/>' if included else macro)
    with pytest.raises(RobotError, match=r"r\.xacro: only defines macros \(gripper\), .*calls <xacro:gripper \.\.\./>"):
        read_description(path)


def test_an_undeclared_prefix_is_kept_in_a_xacro(tmp_path: Path) -> None:
    """What stands under <gazebo> goes through xacro as it is, in an included file's macro, too."""
    sensor = '<gazebo><sensor:camera name="${name}"/></gazebo>'
    _written(tmp_path / "part.xacro", f'{HEAD}<xacro:macro name="camera" params="name">{sensor}</xacro:macro></robot>')
    text = read_description(xacro(tmp_path, '<xacro:include filename="part.xacro"/><link name="a"/><xacro:camera name="c"/>')).text
    assert b'<sensor:camera name="c"/>' in text
    assert b'<x:y z="2"/>' in read_description(xacro(tmp_path, '<link name="a"/><gazebo><x:y z="${1+1}"/></gazebo>')).text


@pytest.mark.parametrize("call", ["$(find small_description)/part.xacro", "package://small_description/part.xacro"])
def test_packages_are_found_in_includes(tmp_path: Path, call: str) -> None:
    """$(find pkg) and package:// lead into --package-dir."""
    (tmp_path / "small_description").mkdir()
    _written(tmp_path / "small_description" / "part.xacro", HEAD + '<link name="inner"/></robot>')
    path = xacro(tmp_path, f'<xacro:include filename="{call}"/>')
    assert b'<link name="inner"/>' in read_description(path, package_dirs=[tmp_path]).text


def test_yaml_is_loaded(tmp_path: Path) -> None:
    """load_yaml reads a file beside the xacro or in a package, units included."""
    (tmp_path / "small_description").mkdir()
    _written(tmp_path / "small_description" / "numbers.yaml", "tilt: !degrees 180\n")
    body = '<xacro:property name="n" value="${xacro.load_yaml(\'package://small_description/numbers.yaml\')}"/>'
    body += '<link name="l${round(n.tilt, 3)}"/>'
    assert b'<link name="l3.142"/>' in read_description(xacro(tmp_path, body), package_dirs=[tmp_path]).text


def test_the_users_rig_yaml_is_not_xacro(tmp_path: Path) -> None:
    """A xacro that loads YAML with units does not teach our own YAML files to run code."""
    from urdfcal.base.errors import RigError
    from urdfcal.calibration.rig_file import read_rig_file

    test_yaml_is_loaded(tmp_path)
    with pytest.raises(RigError, match=r"rig\.yaml:1: the tag '!degrees' is refused"):
        read_rig_file(_written(tmp_path / "rig.yaml", "noise: {spot_mm: !degrees 180}\n"))


ENTITIES = [
    '<!ENTITY a "b">',
    '<!ENTITY a SYSTEM "file:///etc/passwd">',
    '<!ENTITY % a "b">',
    '<!NOTATION n SYSTEM "n"><!ENTITY a SYSTEM "x" NDATA n>',
    '<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">',
]


@pytest.mark.parametrize("declaration", ENTITIES)
@pytest.mark.parametrize("name", ["r.urdf", "r.xacro"])
def test_entity_declarations_are_refused(tmp_path: Path, declaration: str, name: str) -> None:
    """No entity may be declared, of whatever kind; the message has its line."""
    path = _written(tmp_path / name, f"<?xml version='1.0'?>\n<!DOCTYPE robot [\n{declaration}]>\n<robot name='r'><link name='a'/></robot>")
    with pytest.raises(RobotError, match=rf"{name}:3: declares the entity 'a'"):
        read_description(path)


@pytest.mark.parametrize("macro", [False, True])
def test_entity_declarations_are_refused_in_included_files(tmp_path: Path, macro: bool) -> None:
    """An included file may declare no entity either, also when a macro includes it."""
    _written(tmp_path / "bad.xacro", f"<!DOCTYPE robot [{ENTITIES[1]}]>\n<robot><link name='&a;'/></robot>")
    include = '<xacro:include filename="bad.xacro"/>'
    body = f'<xacro:macro name="m" params="">{include}</xacro:macro><xacro:m/>' if macro else include
    with pytest.raises(RobotError, match=r"bad\.xacro:1: declares the entity 'a'"):
        read_description(xacro(tmp_path, body))


def test_a_doctype_alone_is_no_harm(tmp_path: Path) -> None:
    """A DOCTYPE that declares no entity is read, and the file it names is not."""
    path = _written(tmp_path / "r.urdf", URDF.replace("<robot", '<!DOCTYPE robot SYSTEM "nowhere.dtd">\n<robot', 1))
    assert load_robot(path).name == "small"


BROKEN = {
    "<xacro:nope/>": "unknown macro name: xacro:nope",
    '<xacro:include filename="nope.xacro"/>': r"the included file .*nope\.xacro cannot be read: No such file",
    '<xacro:include filename="$(find nope)/a.xacro"/>': r"package 'nope' was not found; .*--package-dir",
    '<xacro:include filename="package:///etc/passwd"/>': "package 'etc' was not found",
    '<link name="${1/0}"/>': "division by zero",
    '<link name="${nope}"/>': "name 'nope' is not defined",
    '<xacro:property name="a" value="${a}"/><link name="${a}"/>': "circular variable definition: a -> a",
    '<xacro:macro name="m" params=""><xacro:m/></xacro:macro><xacro:m/>': "call themselves without end",
    '<xacro:macro name="m" params="x"><link name="${x}"/></xacro:macro><xacro:m/>': r"Undefined parameters \[x\] \(in a call of m\)",
    '<xacro:macro name="m" params="x"><link name="${x}"/></xacro:macro><xacro:m y="1"/>': 'Invalid parameter "y"',
    '<xacro:include filename="r.xacro"/>': "call themselves without end",
    '<xacro:property name="n" value="${xacro.load_yaml(\'nope.yaml\')}"/><link name="${n}"/>': r"xacro: No such file .*nope\.yaml",
    '<link name="$(arg nope)"/>': "nope",
    '<link name="$(env URDFCAL_NOPE)"/>': "xacro: environment variable 'URDFCAL_NOPE' is not set$",
    '<xacro:if value="perhaps"><link name="a"/></xacro:if>': "perhaps",
}


@pytest.mark.parametrize("body", BROKEN)
def test_broken_xacro_is_one_line(tmp_path: Path, body: str, capfd: pytest.CaptureFixture[str]) -> None:
    """Whatever xacro cannot do becomes one RobotError that names the file and the cause, and nothing is printed."""
    with pytest.raises(RobotError, match=rf"r\.xacro: .*{BROKEN[body]}") as error:
        read_description(xacro(tmp_path, body))
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


def test_an_optional_include_may_be_missing(tmp_path: Path) -> None:
    """An include marked optional is passed over when its file is not there."""
    assert (
        b'<link name="a"/>'
        in read_description(xacro(tmp_path, '<xacro:include filename="nope.xacro" optional="true"/><link name="a"/>')).text
    )


def test_what_xacro_prints_reaches_nobody(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Messages and warnings of xacro go neither to stdout nor to stderr."""
    read_description(
        xacro(tmp_path, '<xacro:property name="pi" value="3"/><link name="a${xacro.message(\'hello\')}${xacro.warning(\'careful\')}"/>')
    )
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("""${[0] * 10**11}""", r"xacro: takes more than 0\.5 GB of memory; allow more with --xacro-limit"),
        ("""${'x' * 10**10}""", r"xacro: takes more than 0\.5 GB of memory; allow more with --xacro-limit"),
        ("""${[i for i in range(10**12) if i == -1]}""", r"xacro: not expanded after 3 s; allow more with --xacro-limit"),
        ("""${'x' * 10**8}""", r"xacro: expands to more than 64 MB, which no robot needs"),
    ],
)
def test_an_expansion_is_bounded(tmp_path: Path, body: str, said: str) -> None:
    """A file whose own Python takes all memory, or never ends, ends in a message, and this process has taken none of it."""
    path = xacro(tmp_path, f'<link name="a"/><gazebo>{body}</gazebo>')
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(RobotError, match=rf"r\.xacro: {said}"):
        read_description(path, xacro_limit=XacroLimit(3.0, 0.5))
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000


def test_the_files_that_xacro_read_are_named(tmp_path: Path) -> None:
    """A description knows the files that it includes, those that they include, too; a plain URDF has none."""
    _written(tmp_path / "deep.xacro", HEAD + '<link name="b"/></robot>')
    _written(tmp_path / "part.xacro", HEAD + '<xacro:include filename="deep.xacro"/></robot>')
    found = read_description(xacro(tmp_path, '<xacro:include filename="part.xacro"/><link name="a"/>'))
    assert found.included == (tmp_path / "part.xacro", tmp_path / "deep.xacro")
    assert read_description(_written(tmp_path / "small.urdf", URDF)).included == ()


def test_modules_beside_the_user_are_not_the_childs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A json.py or an XML package in the folder where the user stands is not imported for xacro."""
    for name in ("json.py", "xacro.py", "base64.py"):
        (tmp_path / name).write_text("raise SystemExit(9)")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    assert b'<link name="a"' in read_description(xacro(tmp_path, '<link name="a"/>')).text


UNREADABLE = {
    b"": r"r\.urdf:1: not well-formed XML: no element found",
    b"<robot": r"r\.urdf:1: not well-formed XML: unclosed token",
    b"<robot>\n<link>\n</robot>": r"r\.urdf:3: not well-formed XML: mismatched tag at column 3",
    b"<?xml version='1.0' encoding='nope-8'?><robot/>": r"r\.urdf: cannot be decoded: unknown encoding: nope-8",
    b"<?xml version='1.0' encoding='shift_jis'?><robot/>": r"r\.urdf: cannot be decoded: multi-byte encodings are not supported",
    b"<robot name='\xfc'/>": r"r\.urdf:1: not well-formed XML: not well-formed \(invalid token\)",
    URDF.replace('version="1.0"', 'version="1.0" encoding="UTF-16"').encode("utf-16"): r"r\.urdf: is in UTF-16 or UTF-32.*save it as UTF-8",
}


@pytest.mark.parametrize("text", UNREADABLE, ids=range(len(UNREADABLE)))
def test_text_that_is_no_xml_is_refused(tmp_path: Path, text: bytes) -> None:
    """Text that is not well-formed XML in a byte encoding is refused with its line."""
    (tmp_path / "r.urdf").write_bytes(text)
    with pytest.raises(RobotError, match=UNREADABLE[text]):
        read_description(tmp_path / "r.urdf")


@pytest.mark.parametrize("name", ["nope.urdf", "nope.xacro", "."])
def test_a_file_that_is_not_there_is_refused(tmp_path: Path, name: str) -> None:
    """A missing file, or a folder, is refused by name."""
    with pytest.raises(RobotError, match=r"cannot be read: (No such file|Is a directory)"):
        read_description(tmp_path / name)


def test_a_missing_package_dir_is_refused(tmp_path: Path) -> None:
    """--package-dir must be a folder."""
    with pytest.raises(RobotError, match=r"--package-dir .*nope: no such folder"):
        read_description(_written(tmp_path / "r.urdf", URDF), package_dirs=[tmp_path / "nope"])


def _written(path: Path, text: str) -> Path:
    path.write_text(text, "utf-8")
    return path


def test_many_variants_of_a_file_are_expanded_in_one_process(tmp_path: Path) -> None:
    """Each has its own content of the files that it reads; one that cannot be expanded, or never ends, leaves the others alone."""
    main, part = tmp_path / "a.xacro", tmp_path / "k.yaml"
    main.write_text(
        '<robot name="a" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="k" value="${xacro.load_yaml(\'k.yaml\')}"/>'
        '<link name="l${k.n}"/></robot>'
    )
    part.write_text("n: 1\n")
    place, slow = os.path.realpath(part), main.read_bytes().replace(b"${k.n}", b"${[0 for a in range(k.n) for b in range(k.n)][0]}")
    overlays = [{}, {place: b"n: 2\n"}, {place: b"m: 2\n"}, {place: b"n: 900000\n", os.path.realpath(main): slow}, {place: b"n: 3\n"}]
    found = variants(main, {}, (), XacroLimit(seconds=0.4), overlays)
    made = [each.text and each.text.count(f'"l{number}"'.encode()) for each, number in zip(found, (1, 2, 0, 0, 3), strict=True)]
    assert made == [1, 1, None, None, 1]
    assert "no key 'n'" in found[2].fault
    assert "not expanded after 0.4 s" in found[3].fault
    assert part in found[0].files
