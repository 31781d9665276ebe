"""Xacro packages in the manner of those that makers and users have, small, each with a trick of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

NAMESPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'


@dataclass(frozen=True)
class Package:
    """A package.

    Attributes:
        files: Their bytes by their ways; the first is the description.
        args: Values of xacro arguments.
        joints: Those that are calibrated; all that move for none.
        shared: Whether numbers feed several joints, so that it takes a split.
    """

    files: dict[str, bytes]
    args: dict[str, str]
    joints: tuple[str, ...] = ()
    shared: bool = False

    def write(self, folder: Path) -> Path:
        """Put it into a folder; the description."""
        for way, content in self.files.items():
            place = folder / way
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(content)
        return folder / next(iter(self.files))


def robot(body: str, name: str = "arm") -> str:
    """A xacro document."""
    return f'<?xml version="1.0"?>\n<robot name="{name}" {NAMESPACE}>\n{body}\n</robot>\n'


def joint(name: str, parent: str, child: str, origin: str, kind: str = "revolute") -> str:
    """A joint and the link that it carries."""
    limit = '<limit lower="-3" upper="3" effort="9" velocity="2"/>' if kind == "revolute" else ""
    axis = '<axis xyz="0 0 1"/>' if kind != "fixed" else ""
    return (
        f'  <link name="{child}"/>\n  <joint name="{name}" type="{kind}">\n    <parent link="{parent}"/>\n    <child link="{child}"/>\n'
        f"    {origin}\n    {axis}{limit}\n  </joint>\n"
    )


def package(body: str, args: dict[str, str] | None = None, shared: bool = False, joints: tuple[str, ...] = (), **files: str) -> Package:
    its = {"urdf/arm.urdf.xacro": robot(body).encode(), "package.xml": b"<package><name>arm_description</name></package>"}
    its |= {name.replace("__", "/").replace("_DOT_", "."): text.encode() for name, text in files.items()}
    return Package(its, args or {}, joints, shared)


BASE = '  <link name="base"/>\n'


def literals() -> Package:
    """Numbers in the origins themselves, one origin absent, others half stated."""
    return package(
        BASE
        + joint("j1", "base", "l1", "<origin xyz='0 0  0.333' rpy=\"0 0 0\" />")
        + joint("j2", "l1", "l2", '<origin rpy="-1.5707963267948966 0 0"/>')
        + joint("j3", "l2", "l3", '<origin xyz="0 -0.316 1e-3"/>')
        + joint("j4", "l3", "l4", "<!-- none -->")
    )


def properties() -> Package:
    """Properties, of which some also tell how long a link looks."""
    return package(
        '  <xacro:property name="d1" value="0.333"/>\n  <xacro:property name="a2" value=" 0.425 "/>\n'
        + '  <xacro:property name="half" value="${pi/2}"/>\n'
        + '  <link name="base"><visual><origin xyz="0 0 ${d1/2}"/><geometry><box size="${d1} 1 1"/></geometry></visual></link>\n'
        + joint("j1", "base", "l1", '<origin xyz="0 0 ${d1}" rpy="0 0 0"/>')
        + joint("j2", "l1", "l2", '<origin xyz="${a2} 0 0" rpy="${-half} 0 ${half}"/>')
        + joint("j3", "l2", "l3", '<origin xyz="-${a2} 0 ${d1 + 0.01}" rpy="${radians(90)} 0 ${45*pi/180}"/>')
    )


def units() -> Package:
    """YAML in degrees and millimetres, with tags, quotes, flow lists and comments."""
    return package(
        '  <xacro:property name="k" value="${xacro.load_yaml(\'../config/kin.yaml\')}"/>\n'
        + BASE
        + joint("j1", "base", "l1", '<origin xyz="0 0 ${k.j1.z}" rpy="${k.j1.roll} 0 0"/>')
        + joint("j2", "l1", "l2", "<origin xyz=\"${k['j2']['xyz'][0]} ${k['j2']['xyz'][1]} 0\" rpy=\"0 ${k.j2.pitch} 0\"/>")
        + joint("j3", "l2", "l3", '<origin xyz="${k.j3.xyz}" rpy="${k.j3.yaw} 0 0"/>'),
        config__kin_DOT_yaml="# of the maker\nj1: {z: !millimeters 333.0, roll: !degrees -90}  # é\n"
        'j2:\n    xyz: [ 0.1,0.2,   0 ]\n    pitch: "0.125"\nj3:\n  xyz: "0.5 0  .25"\n  yaw: !radians pi/3\n',
    )


_UR = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
_UR_MACRO = """  <xacro:macro name="read_model_data" params="kinematics_file">
    <xacro:property name="config" value="${xacro.load_yaml(kinematics_file)}"/>
    <xacro:property name="sec" value="${config['kinematics']}"/>
PROPERTIES  </xacro:macro>
  <xacro:macro name="ur_robot" params="prefix parent *origin kinematics_file reach:=^|1.3">
    <xacro:read_model_data kinematics_file="${kinematics_file}"/>
    <joint name="${prefix}base_joint" type="fixed">
      <xacro:insert_block name="origin"/>
      <parent link="${parent}"/><child link="${prefix}base_link"/>
    </joint>
    <link name="${prefix}base_link"/>
JOINTS  </xacro:macro>
"""


def _ur_macro() -> str:
    six = ("x", "y", "z", "roll", "pitch", "yaw")
    stated = "".join(
        f'    <xacro:property name="{name}_{one}" value="${{sec[\'{name}\'][\'{one}\']}}" scope="parent"/>\n' for name in _UR for one in six
    )
    parents = ("base_link", *(f"{name}_link" for name in _UR))
    joints = "".join(
        joint(
            f"${{prefix}}{name}_joint",
            f"${{prefix}}{parent}",
            f"${{prefix}}{name}_link",
            f'<origin xyz="${{{name}_x}} ${{{name}_y}} ${{{name}_z}}" rpy="${{{name}_roll}} ${{{name}_pitch}} ${{{name}_yaw}}"/>',
        )
        for name, parent in zip(_UR, parents, strict=False)
    )
    return robot(_UR_MACRO.replace("PROPERTIES", stated).replace("JOINTS", joints))


def _ur_yaml() -> str:
    rows = ("0 0 0.089159 0 0 0", "0 0 0 1.570796327 0 0", "-0.425 0 0 0 0 0", "-0.39225 0 0.10915 0 0 0")
    rows += ("0 -0.09465 -1.941303950897609e-11 1.570796327 0 0", "0 0.0823 0 1.570796326589793 3.141592653589793 3.141592653589793")
    text = "kinematics:\n"
    for name, row in zip(_UR, rows, strict=True):
        keys = zip(("x", "y", "z", "roll", "pitch", "yaw"), row.split(), strict=True)
        text += f"  {name}:\n" + "".join(f"    {key}: {value}\n" for key, value in keys)
    return text + "  hash: calib_12788084448423163542\n"


_UR_CALL = '<xacro:ur_robot prefix="{}" parent="world" kinematics_file="{}"><origin xyz="{}" rpy="0 0 0"/></xacro:ur_robot>\n'


def ur() -> Package:
    """As ur_description: kinematics in a YAML that a macro loads into properties of its caller."""
    call = _UR_CALL.format("", "$(arg kinematics)", "0 0 0")
    return package(
        '  <xacro:arg name="kinematics" default="config/default.yaml"/>\n  <xacro:include filename="inc/ur_macro.xacro"/>\n'
        + f'  <link name="world"/>\n  {call}',
        urdf__inc__ur_macro_DOT_xacro=_ur_macro(),
        urdf__config__default_DOT_yaml=_ur_yaml(),
    )


def two_arms() -> Package:
    """A cell with the same arm twice, each with a YAML of its own."""
    return package(
        '  <xacro:include filename="inc/ur_macro.xacro"/>\n  <link name="world"/>\n'
        + "  "
        + _UR_CALL.format("left_", "config/left.yaml", "0 0.5 0")
        + "  "
        + _UR_CALL.format("right_", "config/right.yaml", "0 -0.5 0"),
        urdf__inc__ur_macro_DOT_xacro=_ur_macro(),
        urdf__config__left_DOT_yaml=_ur_yaml(),
        urdf__config__right_DOT_yaml=_ur_yaml(),
    )


def two_arms_one_yaml() -> Package:
    """The same with one YAML for both."""
    its = two_arms()
    files = {way: text.replace(b"config/right.yaml", b"config/left.yaml") for way, text in its.files.items() if "right.yaml" not in way}
    return Package(files, {}, shared=True)


_FRANKA = """  <xacro:macro name="franka_joint" params="arm_id number parent origin *limits">
    <xacro:property name="o" value="${origin['kinematic']}"/>
    <link name="${arm_id}_link${number}"/>
    <joint name="${arm_id}_joint${number}" type="revolute">
      <origin xyz="${o.x} ${o.y} ${o.z}" rpy="${o.roll} ${o.pitch} ${o.yaw}"/>
      <parent link="${parent}"/><child link="${arm_id}_link${number}"/>
      <axis xyz="0 0 1"/><xacro:insert_block name="limits"/>
    </joint>
  </xacro:macro>
  <xacro:macro name="franka_arm" params="arm_id kinematics">
    <link name="${arm_id}_link0"/>
    <xacro:franka_joint arm_id="${arm_id}" number="1" parent="${arm_id}_link0" origin="${kinematics['joint1']}">LIMIT</xacro:franka_joint>
    <xacro:franka_joint arm_id="${arm_id}" number="2" parent="${arm_id}_link1" origin="${kinematics['joint2']}">LIMIT</xacro:franka_joint>
    <xacro:if value="${len(kinematics) > 2}">
    <xacro:franka_joint arm_id="${arm_id}" number="3" parent="${arm_id}_link2" origin="${kinematics['joint3']}">LIMIT</xacro:franka_joint>
    </xacro:if>
  </xacro:macro>
"""


def franka() -> Package:
    """As franka_description: a dictionary of kinematics handed to a macro, a macro for each joint, arguments in `$(find)`."""
    yaml = (
        "joint1:\n  kinematic: {x: 0, y: 0, z: 0.333, roll: 0, pitch: 0, yaw: 0}\njoint2:\n  kinematic:\n    x : 0\n    y : 0\n    z : 0\n"
    )
    yaml += "    roll : -1.570796326794897\n    pitch : 0\n    yaw : 0\n"
    yaml += "joint3:\n  kinematic: {x: 0, y: -0.316, z: 0, roll: 1.57079, pitch: 0, yaw: 0}\n"
    limit = '<limit lower="-2" upper="2" effort="8" velocity="2"/>'
    place = "$(find arm_description)/robots/$(arg arm_id)/kin.yaml"
    call = f'<xacro:franka_arm arm_id="$(arg arm_id)" kinematics="${{xacro.load_yaml(\'{place}\')}}"/>'
    return package(
        '  <xacro:arg name="arm_id" default="fr3"/>\n  <xacro:include filename="$(find arm_description)/robots/arm.xacro"/>\n  ' + call,
        robots__arm_DOT_xacro=robot(_FRANKA.replace("LIMIT", limit)),
        robots__fr3__kin_DOT_yaml=yaml,
    )


def franka_twice() -> Package:
    """Two arms of one YAML, whose origins all come out of one macro, called inside the joints; one hangs where a block says."""
    macro = '  <xacro:macro name="kin" params="name config">\n    <xacro:property name="o" value="${config[name]}"/>\n'
    macro += '    <origin xyz="${o.x} 0 ${o.z}" rpy="0 0 ${o.yaw}"/>\n  </xacro:macro>\n'
    macro += '  <xacro:macro name="fr_arm" params="id config *at">\n'
    macro += joint("${id}_mount", "base", "${id}_0", '<xacro:insert_block name="at"/>')
    macro += joint("${id}_j1", "${id}_0", "${id}_1", '<xacro:kin name="j1" config="${config}"/>')
    macro += joint("${id}_j2", "${id}_1", "${id}_2", '<xacro:kin name="j2" config="${config}"/>') + "  </xacro:macro>\n"
    call = '  <xacro:fr_arm id="{}" config="${{xacro.load_yaml(\'kin.yaml\')}}"><origin xyz="0 {} 0"/></xacro:fr_arm>\n'
    return package(
        macro + BASE + call.format("left", 0.5) + call.format("right", -0.5),
        shared=True,
        urdf__kin_DOT_yaml="j1: {x: 0, z: 0.333, yaw: 0}\nj2: {x: 0.1, z: 0, yaw: 0.5}\n",
    )


def calls() -> Package:
    """One macro for all joints, its numbers at the calls: words, rows of words, expressions."""
    macro = '  <xacro:macro name="axis" params="n parent xyz r:=0 y:=\'0\'">\n'
    macro += joint("j${n}", "${parent}", "l${n}", '<origin xyz="${xyz}" rpy="${radians(r)} 0 ${y}"/>') + "  </xacro:macro>\n"
    return package(
        macro
        + BASE
        + '  <xacro:axis n="1" parent="base" xyz="0 0 0.4" r="-90" y="0.1"/>\n'
        + '  <xacro:axis n="2" parent="l1" xyz="0.025  0 ${2*0.2}" r="90" y="${pi/4}"/>\n'
        + '  <xacro:axis n="3" parent="l2" xyz="0 0.1 0" r="-45.5" y="${0.5}"/>',
        shared=True,  # the pitch is one for all
    )


def defaults() -> Package:
    """A macro called once, whose numbers are defaults of its parameters."""
    macro = '  <xacro:macro name="arm" params="prefix z:=0.2 xyz:=\'0 0.1 0.2\' roll:=${pi/2} *block">\n'
    macro += joint("${prefix}j1", "base", "${prefix}l1", '<origin xyz="0 0 ${z}" rpy="${roll} 0 0"/>')
    macro += joint("${prefix}j2", "${prefix}l1", "${prefix}l2", '<origin xyz="${xyz}" rpy="0 0 0"/>')
    macro += '    <xacro:insert_block name="block"/>\n  </xacro:macro>\n'
    return package(
        macro
        + BASE
        + '  <xacro:arm prefix="a_"><link name="tip"/></xacro:arm>\n'
        + joint("t", "a_l2", "tip", "", "fixed").split("\n", 1)[1]
    )


def twice() -> Package:
    """A macro with numbers of its own, called twice."""
    macro = '  <xacro:macro name="leg" params="side">\n'
    macro += joint("${side}_hip", "base", "${side}_thigh", '<origin xyz="0 0.1 0" rpy="0 0 ${pi/2}"/>')
    macro += joint("${side}_knee", "${side}_thigh", "${side}_shin", "<origin xyz='0.3 0 0'/>")
    macro += joint("${side}_ankle", "${side}_shin", "${side}_foot", "") + "  </xacro:macro>\n"
    return package(macro + BASE + '  <xacro:leg side="left"/>\n  <xacro:leg side="right" />', shared=True)


def nested() -> Package:
    """The same in a macro that is called twice itself, over two files, one of them in a namespace."""
    inner = '  <xacro:macro name="finger" params="name">\n'
    inner += (
        joint("${name}_bend", "${name.split('_')[0]}_palm", "${name}_tip", '<origin xyz="0.1 0 0" rpy="0 0 0"/>') + "  </xacro:macro>\n"
    )
    outer = '  <xacro:include filename="finger.xacro" ns="f"/>\n  <xacro:macro name="hand" params="side">\n'
    outer += joint("${side}_wrist", "base", "${side}_palm", '<origin xyz="0 0 0.2" rpy="0 0 0"/>')
    outer += '    <xacro:f.finger name="${side}_a"/>\n    <xacro:f.finger name="${side}_b"/>\n  </xacro:macro>\n'
    return package(
        '  <xacro:include filename="hand.xacro"/>\n' + BASE + '  <xacro:hand side="left"/>\n  <xacro:hand side="right"/>',
        urdf__hand_DOT_xacro=robot(outer),
        urdf__finger_DOT_xacro=robot(inner),
        shared=True,
    )


def conditions() -> Package:
    """Numbers under xacro:if and xacro:unless, chosen by an argument; one that is a count and a length at once."""
    return package(
        '  <xacro:arg name="long" default="true"/>\n  <xacro:arg name="reach" default="0.7"/>\n'
        + '  <xacro:property name="dof" value="2"/>\n'
        + BASE
        + '  <xacro:if value="$(arg long)">\n    <xacro:property name="a" value="0.9"/>\n  </xacro:if>\n'
        + '  <xacro:unless value="$(arg long)">\n    <xacro:property name="a" value="0.6"/>\n  </xacro:unless>\n'
        + joint("j1", "base", "l1", '<origin xyz="${a} 0 $(arg reach)" rpy="0 0 0"/>')
        + '  <xacro:if value="${dof == 2}">\n'
        + joint("j2", "l1", "l2", '<origin xyz="$(arg reach) -$(arg reach) ${dof}" rpy="0 0 0"/>')
        + "  </xacro:if>\n",
        {"long": "false", "reach": "0.8"},
    )


def dictionary() -> Package:
    """A dictionary of lists in an expression, from which each call takes its own."""
    macro = '  <xacro:macro name="axis" params="n parent">\n    <xacro:property name="o" value="${table[n]}"/>\n'
    macro += (
        joint("j${n}", "${parent}", "l${n}", '<origin xyz="${o[0]} ${o[1]} ${o[2]}" rpy="${o[3]} ${o[4]} ${o[5]}"/>') + "  </xacro:macro>\n"
    )
    table = "${dict([(1, [0, 0, 0.4, 0, 0, 0]), (2, [0.1, -0.2, 0, -1.57, 0, 0.5])])}"
    return package(
        f'  <xacro:property name="table" value="{table}"/>\n'
        + macro
        + BASE
        + '  <xacro:axis n="${1}" parent="base"/>\n  <xacro:axis n="${2}" parent="l1"/>'
    )


def loop() -> Package:
    """A macro that calls itself for each entry: one call, many joints."""
    macro = '  <xacro:macro name="chain" params="names parent">\n    <xacro:property name="n" value="${names[0]}"/>\n'
    macro += joint("j_${n}", "${parent}", "l_${n}", "<origin xyz=\"${k[n]['x']} 0 ${k[n]['z']}\" rpy=\"0 ${k[n]['pitch']} 0\"/>")
    macro += '    <xacro:if value="${len(names) > 1}">\n'
    macro += '      <xacro:chain names="${names[1:]}" parent="l_${n}"/>\n    </xacro:if>\n  </xacro:macro>\n'
    return package(
        '  <xacro:property name="k" value="${xacro.load_yaml(\'kin.yaml\')}"/>\n'
        + macro
        + BASE
        + "  <xacro:chain names=\"${['a', 'b', 'c']}\" parent=\"base\"/>",
        urdf__kin_DOT_yaml="".join(f"{name}: {{x: 0.{n}, z: {n}.5e-1, pitch: 0.{n}0}}\n" for n, name in enumerate("abc", 1)),
        shared=True,  # y, roll and yaw are one for all
    )


def blocks() -> Package:
    """Origins as blocks: in properties, handed to a macro, made by xacro:attribute."""
    macro = '  <xacro:macro name="axis" params="n parent *origin">\n'
    macro += joint("j${n}", "${parent}", "l${n}", '<xacro:insert_block name="origin"/>') + "  </xacro:macro>\n"
    return package(
        '  <xacro:property name="at">\n    <origin xyz="0 0 0.2"/>\n  </xacro:property>\n'
        + macro
        + BASE
        + '  <xacro:axis n="1" parent="base"><origin xyz="0 0 0.3" rpy="0 0 0"/></xacro:axis>\n'
        + joint("j2", "l1", "l2", '<xacro:insert_block name="at"/>')
        + joint("j3", "l2", "l3", '<origin><xacro:attribute name="xyz" value="0.1 0 ${0.1*3}"/></origin>')
    )


def crlf_latin() -> Package:
    """A byte-order mark and Windows' line ends in one file, Latin-1 in the other."""
    arm = BASE + '  <xacro:include filename="rest.xacro"/>\n' + joint("j1", "base", "l1", '<origin xyz="0 0 0.3" rpy="0 0 0"/>')
    rest = robot("<!-- é -->\n" + joint("j2", "l1", "l2", '<origin xyz="0.2 0 0" rpy="0 0 0"/>')).replace(
        'version="1.0"', 'version="1.0" encoding="iso-8859-1"'
    )
    return Package(
        {
            "urdf/arm.urdf.xacro": b"\xef\xbb\xbf" + robot(arm).replace("\n", "\r\n").encode(),
            "urdf/rest.xacro": rest.rstrip("\n").encode("latin-1"),
        },
        {},
    )


def one_property() -> Package:
    """A row of numbers in a property that two joints share, each origin being its own."""
    return package(
        '  <xacro:property name="xyz" value="0 0 0.25"/>\n  <xacro:property name="rpy" value="0 0 0"/>\n'
        + BASE
        + joint("j1", "base", "l1", '<origin xyz="${xyz}" rpy="${rpy}"/>')
        + joint("j2", "l1", "l2", '<origin xyz="${xyz}" rpy="${rpy}"/>')
    )


def evaluated() -> Package:
    """`$(eval ...)`, an argument as text, a choice in an expression, an origin over several lines."""
    return package(
        '  <xacro:arg name="n" default="0.3"/>\n  <xacro:property name="t" value="b"/>\n'
        + BASE
        + joint("j1", "base", "l1", '<origin xyz="$(eval 0.1 + 0.2) 0 ${xacro.arg(\'n\')}" rpy="0 0 $(arg n)"/>')
        + joint(
            "j2", "l1", "l2", "<origin\n   xyz = \"0\n   ${0.2 if t == 'a' else 0.35}\n ${max(0.1,\n 0.2)}\"\n rpy\n= '0 0 0' ></origin>"
        )
    )


def scopes() -> Package:
    """Properties that a macro sets for its caller or for all, and one that is set twice."""
    macro = '  <xacro:macro name="setup">\n    <xacro:property name="z" value="0.44" scope="parent"/>\n'
    macro += '    <xacro:property name="gx" value="${0.1}" scope="global"/>\n  </xacro:macro>\n  <xacro:setup/>\n'
    again = '  <xacro:property name="z" value="0.55"/>\n'
    return package(
        macro
        + BASE
        + joint("j1", "base", "l1", '<origin xyz="${gx} 0 ${z}" rpy="0 0 0"/>')
        + again
        + joint("j2", "l1", "l2", '<origin xyz="${gx} 0 ${z}" rpy="0 0 0"/>')
    )


def anchors() -> Package:
    """YAML with an anchor, so that one entry is read for two joints."""
    return package(
        '  <xacro:property name="k" value="${xacro.load_yaml(\'kin.yaml\')}"/>\n'
        + BASE
        + joint("j1", "base", "l1", '<origin xyz="${k.a.x} ${k.a.y} ${k.a.z}" rpy="${k.a.r} 0 0"/>')
        + joint("j2", "l1", "l2", '<origin xyz="${k.b.x} ${k.b.y} ${k.b.z}" rpy="${k.b.r} 0 0"/>'),
        urdf__kin_DOT_yaml="a: &a\n  x: 0.1\n  y: 0\n  z: 3.0e-1\n  r: !degrees 45.0\nb:\n  <<: *a\n  z: .2\n",
    )


def mirrored() -> Package:
    """A macro called twice with a sign."""
    macro = '  <xacro:macro name="arm" params="side reflect">\n'
    macro += (
        joint("${side}_a", "base", "${side}_1", '<origin xyz="0 ${reflect*0.2} 0.1" rpy="${reflect*pi/2} 0 0"/>') + "  </xacro:macro>\n"
    )
    return package(macro + BASE + '  <xacro:arm side="l" reflect="1"/>\n  <xacro:arm side="r" reflect="-1"/>', shared=True)


PACKAGES: dict[str, Callable[[], Package]] = {
    each.__name__: each
    for each in (
        literals, properties, units, ur, two_arms, two_arms_one_yaml, franka, franka_twice, calls, defaults, twice, nested, conditions,
        dictionary, loop, blocks, crlf_latin, one_property, evaluated, scopes, anchors, mirrored,
    )
}  # fmt: skip
