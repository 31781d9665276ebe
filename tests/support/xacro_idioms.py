# ruff: noqa: E501
"""More xacro packages, each with an idiom that makers' own descriptions have: TALOS, xArm, Kortex, ABB, KUKA and others."""

from __future__ import annotations

from collections.abc import Callable

from tests.support.xacro_packages import BASE, Package, joint, package, robot

_SIX = ("x", "y", "z", "roll", "pitch", "yaw")


def _offsets(numbers: tuple[int, ...]) -> str:
    its = (f'  <xacro:property name="arm_{n}_joint_{one}_offset" value="0.0" />' for n in numbers for one in _SIX)
    return robot("\n".join(its), "offsets")


def offsets_aside() -> Package:
    """As PAL's TALOS: a file of offsets for each side, included inside the macro, added to numbers that are mirrored."""
    macro = '  <xacro:macro name="talos_arm" params="name parent side reflect">\n    <xacro:unless value="$(arg test)">\n'
    macro += '      <xacro:include filename="$(find arm_description)/calibration/arm_${side}.xacro" />\n    </xacro:unless>\n'
    for n, (y, z) in enumerate(((0.1575, 0.232), (0.1365, 0.04673)), 1):
        words = f"${{0.005 + arm_{n}_joint_x_offset}} ${{{y}*reflect + arm_{n}_joint_y_offset}} ${{{z} + arm_{n}_joint_z_offset}}"
        turns = f"${{-90.0 * deg_to_rad + arm_{n}_joint_roll_offset}} ${{0.0 * deg_to_rad + arm_{n}_joint_pitch_offset}} "
        turns += f"${{15.0 * deg_to_rad*reflect + arm_{n}_joint_yaw_offset}}"
        parent = "${parent}" if n == 1 else "${name}_${side}_1_link"
        macro += joint(
            f"${{name}}_${{side}}_{n}_joint", parent, f"${{name}}_${{side}}_{n}_link", f'<origin xyz="{words}"\n rpy="{turns}"/>'
        )
    macro += "  </xacro:macro>\n"
    return package(
        '  <xacro:arg name="test" default="false"/>\n  <xacro:property name="deg_to_rad" value="0.01745329251994329577"/>\n'
        + macro
        + BASE
        + '  <xacro:talos_arm name="arm" parent="base" side="left" reflect="1"/>\n'
        + '  <xacro:talos_arm name="arm" parent="base" side="right" reflect="-1"/>\n',
        calibration__arm_left_DOT_xacro=_offsets((1, 2)),
        calibration__arm_right_DOT_xacro=_offsets((1, 2)),
    )


def suffix() -> Package:
    """As xarm_description: parameters over many lines with defaults, a YAML whose name is put together under conditions, loaded in a macro."""
    urdf = '  <xacro:macro name="xarm_urdf" params="prefix\n    kinematics_params_filename:=\'none\'\n    lower:=${-2.0*pi}  ">\n'
    urdf += '    <xacro:property name="params" value="${xacro.load_yaml(kinematics_params_filename)[\'kinematics\']}"/>\n'
    for n in (1, 2):
        parent = "${prefix}base" if n == 1 else "${prefix}link1"
        words = " ".join(f"${{params['joint{n}']['{one}']}}" for one in _SIX[:3])
        turns = " ".join(f"${{params['joint{n}']['{one}']}}" for one in _SIX[3:])
        urdf += joint(f"${{prefix}}joint{n}", parent, f"${{prefix}}link{n}", f'<origin\n        xyz="{words}"\n        rpy="{turns}" />')
    urdf += "  </xacro:macro>\n"
    device = "  <xacro:macro name=\"xarm_device\" params=\"\n    prefix:=''\n    dof:=7\n    robot_type:='xarm'\n    kinematics_suffix:=''\n    \">\n"
    device += '    <xacro:property name="robot_name" value="${robot_type}${dof}" />\n    <xacro:if value="${kinematics_suffix != \'\'}">\n'
    folder = "$(find arm_description)/config/kinematics"
    device += f'      <xacro:property name="file" value="{folder}/user/${{robot_name}}_kinematics_${{kinematics_suffix}}.yaml"/>\n'
    device += (
        f'    </xacro:if>\n    <xacro:unless value="${{kinematics_suffix != \'\'}}">\n      <xacro:property name="file" value="{folder}/'
    )
    device += 'default.yaml"/>\n    </xacro:unless>\n    <xacro:include filename="$(find arm_description)/urdf/xarm.xacro"/>\n'
    device += '    <link name="${prefix}base"/>\n'
    device += '    <xacro:xarm_urdf prefix="${prefix}" kinematics_params_filename="${file}"/>\n  </xacro:macro>\n'
    yaml = "kinematics:\r\n  joint1:\r\n    x: 0\r\n    y: 0\r\n    z: 0.267\r\n    roll: 0\r\n    pitch: 0\r\n    yaw: 0\r\n"
    yaml += "  joint2:\r\n    x: 0\r\n    y: -1e-05\r\n    z: 0.0\r\n    roll: -1.5708\r\n    pitch: 5.9e-4\r\n    yaw: 0\r\n"
    return package(
        '  <xacro:arg name="kinematics_suffix" default=""/>\n'
        + device
        + '  <xacro:xarm_device prefix="L_" dof="6" kinematics_suffix="$(arg kinematics_suffix)"/>\n',
        {"kinematics_suffix": "A77"},
        urdf__xarm_DOT_xacro=robot(urdf),
        config__kinematics__user__xarm6_kinematics_A77_DOT_yaml=yaml,
        config__kinematics__default_DOT_yaml=yaml,
    )


def exponents() -> Package:
    """As kortex_description: a macro's file chosen by a number of joints, numbers such as 2.7629E-18, attributes on lines of their own."""
    macro = '  <xacro:macro name="load_arm" params="\n    parent\n    prefix\n    *origin\n    use_internal:=false">\n'
    macro += '    <joint name="${prefix}base_joint" type="fixed">\n      <xacro:insert_block name="origin" />\n'
    macro += '      <parent\n        link="${parent}"/>\n      <child link="${prefix}base_link" />\n    </joint>\n    <link name="${prefix}base_link"/>\n'
    macro += joint(
        "${prefix}joint_1", "${prefix}base_link", "${prefix}s", '<origin xyz="0 0 0.15643" rpy="3.1416 2.7629E-18 -4.9305E-36" />'
    )
    macro += joint(
        "${prefix}joint_2", "${prefix}s", "${prefix}h", '<origin xyz="0 +5.375e-3 -.12838" rpy="1.5708 2.1343E-17 -1.1102E-16" />'
    )
    return package(
        '  <xacro:arg name="dof" default="7"/>\n  <xacro:property name="dof" value="$(arg dof)"/>\n  <link name="world"/>\n'
        + '  <xacro:include filename="$(find arm_description)/arms/${dof}dof/urdf/arm_macro.xacro" />\n'
        + '  <xacro:load_arm parent="world" prefix=""><origin xyz="0 0 1" rpy="0 0 0"/></xacro:load_arm>\n',
        arms__7dof__urdf__arm_macro_DOT_xacro=robot(macro + "  </xacro:macro>\n"),
    )


def millimetres() -> Package:
    """Lists in millimetres and degrees, from which a macro's parameters are taken, worked out where they are used."""
    macro = '  <xacro:macro name="axis" params="n parent mm deg">\n'
    words = " ".join(f"${{mm[{axis}]*0.001}}" for axis in range(3))
    turns = " ".join(f"${{radians(deg[{axis}])}}" for axis in range(3))
    macro += joint("j${n}", "${parent}", "l${n}", f'<origin xyz="{words}" rpy="{turns}"/>') + "  </xacro:macro>\n"
    return package(
        macro
        + BASE
        + '  <xacro:axis n="1" parent="base" mm="${[0, 0, 333]}" deg="${[0, 0, 0.0]}"/>\n'
        + '  <xacro:axis n="2" parent="l1" mm="${[25.5, -0.5, 0]}" deg="${[-90, 0, 0]}"/>\n'
        + '  <xacro:axis n="3" parent="l2" mm="${(0, -316, 1e1)}" deg="${[90, 0.0, 45]}"/>'
    )


def joined() -> Package:
    """A row of numbers that an expression puts together, out of YAML that lists lists."""
    join = "${' '.join([str(v) for v in k[%d][0:3]])}", "${' '.join([str(v) for v in k[%d][3:6]])}"
    joints = "".join(
        joint(f"j{n}", "base" if n == 1 else f"l{n - 1}", f"l{n}", f'<origin xyz="{join[0] % (n - 1)}" rpy="{join[1] % (n - 1)}"/>')
        for n in (1, 2, 3)
    )
    return package(
        "  <xacro:property name=\"k\" value=\"${xacro.load_yaml('kin.yaml')['rows']}\"/>\n" + BASE + joints,
        urdf__kin_DOT_yaml="rows:\n  - [0, 0, 0.4, 0, 0, 0]\n  - [0.025,0.0,0,-1.5707963267948966,0,0]\n  - - 0.455\n    - 0\n    - 0\n"
        "    - 0\n    - 1.0e-3\n    - 0\n",
    )


def choices() -> Package:
    """Numbers that a condition in an expression chooses, of a model and of a side; a default that comes from an outer scope."""
    macro = '  <xacro:macro name="arm" params="side variant:=^|short">\n    <xacro:property name="l" value="${1 if side == \'left\' else -1}"/>\n'
    macro += joint(
        "${side}_1", "base", "${side}_l1", '<origin xyz="0 ${l*0.3} ${0.4 if variant == \'long\' else 0.3}" rpy="0 0 ${l*pi/2}"/>'
    )
    macro += joint("${side}_2", "${side}_l1", "${side}_l2", '<origin xyz="${dict(long=0.5, short=0.4)[variant]} 0 0"/>')
    return package(
        '  <xacro:property name="variant" value="long"/>\n' + macro + "  </xacro:macro>\n" + BASE + '  <xacro:arm side="left"/>\n'
    )


def parameters() -> Package:
    """A D-H table in YAML, of which a macro works out origins by sine and cosine."""
    macro = '  <xacro:macro name="dh" params="n parent row">\n    <xacro:property name="r" value="${table[row]}"/>\n'
    words = "${r.a*cos(r.theta)} ${r.a*sin(r.theta)} ${r.d}"
    macro += joint("j${n}", "${parent}", "l${n}", f'<origin xyz="{words}" rpy="${{r.alpha}} 0 ${{r.theta}}"/>') + "  </xacro:macro>\n"
    return package(
        '  <xacro:property name="table" value="${xacro.load_yaml(\'dh.yaml\')}"/>\n'
        + macro
        + BASE
        + '  <xacro:dh n="1" parent="base" row="one"/>\n  <xacro:dh n="2" parent="l1" row="two"/>',
        urdf__dh_DOT_yaml="one: {a: 0.15, d: 0.45, alpha: -1.57079632679, theta: 0.3}\ntwo: {a: 0.6, d: 0, alpha: 0, theta: -1.57079632679}\n",
        shared=True,  # the pitch is one for all
    )


def escaped() -> Package:
    """Quotes as entities in expressions, apostrophes about attributes, a comment and CDATA with the same words."""
    return package(
        "  <xacro:property name='k' value='${dict(j1=dict(x=0.1, z=-0.2), j2=[0.3, 4e-1])}'/>\n"
        + '  <!-- <origin xyz="${k} 0 0"/> -->\n  <link name="base"><!-- 0.1 --></link>\n'
        + joint("j1", "base", "l1", '<origin xyz="${k[&quot;j1&quot;][&quot;x&quot;]} 0 ${k[&quot;j1&quot;][&quot;z&quot;]}" rpy="0 0 0"/>')
        + joint("j2", "l1", "l2", "<origin rpy='0 0 ${pi &#47; 4 if 1 &lt; 2 else 0}' xyz='${k[\"j2\"][0]} ${k[\"j2\"][1]} 0'/>")
        + '  <gazebo><plugin name="p"><![CDATA[<origin xyz="0.1 0 0"/>]]></plugin></gazebo>\n'
    )


def containers() -> Package:
    """Blocks with everything a joint holds, handed on by macros in macros."""
    macro = '  <xacro:macro name="axis" params="name parent **content">\n    <link name="${name}_link"/>\n'
    macro += '    <joint name="${name}" type="revolute"><parent link="${parent}"/><child link="${name}_link"/>\n'
    macro += '      <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>\n'
    macro += '      <xacro:insert_block name="content"/>\n    </joint>\n  </xacro:macro>\n'
    macro += '  <xacro:macro name="pair" params="a b *at_a *at_b">\n'
    macro += '    <xacro:axis name="${a}" parent="base"><c><xacro:insert_block name="at_a"/></c></xacro:axis>\n'
    macro += '    <xacro:axis name="${b}" parent="${a}_link"><c><xacro:insert_block name="at_b"/></c></xacro:axis>\n  </xacro:macro>\n'
    return package(
        macro
        + BASE
        + '  <xacro:pair a="lift" b="tilt">\n    <origin xyz="0 0 0.6"/>\n    <origin rpy="0 ${-pi/2} 0" xyz="0.1 0 0"/>\n  </xacro:pair>\n'
    )


def counted() -> Package:
    """Numbers that are also masses, inertias, limits and parameters of a plug-in."""
    return package(
        '  <xacro:property name="l" value="0.4"/>\n  <xacro:property name="r" value="0.05" />\n'
        + '  <link name="base"><inertial><origin xyz="0 0 ${l/2}"/><mass value="${l*10}"/>'
        + '<inertia ixx="${l*l/12}" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>\n'
        + joint("j1", "base", "l1", '<origin xyz="${r} 0 ${l}" rpy="0 0 ${r}"/>')
        + joint("j2", "l1", "l2", '<origin xyz="0 -${r} ${l - r}" rpy="0 0 0"/>').replace('upper="3"', 'upper="${l*7}"')
        + '  <ros2_control name="c" type="system"><joint name="j1"><param name="length">${l}</param></joint></ros2_control>\n'
    )


def two_files() -> Package:
    """One macro's name in two files, told apart by namespaces; properties under them; a file that is read twice."""

    def arm(z: float) -> str:
        its = f'  <xacro:property name="z" value="{z}"/>\n  <xacro:macro name="arm" params="p">\n'
        return robot(its + joint("${p}j", "base", "${p}l", '<origin xyz="0 0 ${z}" rpy="0 0 0"/>') + "  </xacro:macro>\n")

    return package(
        '  <xacro:include filename="a.xacro" ns="a"/>\n  <xacro:include filename="./b.xacro" ns="b"/>\n  <xacro:include filename="b.xacro" ns="c"/>\n'
        + BASE
        + '  <xacro:a.arm p="a_"/>\n  <xacro:b.arm p="b_"/>\n'
        + joint("j", "base", "tip", '<origin xyz="${a.z} 0 ${b.z + c.z}" rpy="0 0 0"/>'),
        urdf__a_DOT_xacro=arm(0.25),
        urdf__b_DOT_xacro=arm(0.35),
    )


def nests() -> Package:
    """Includes in includes, by `$(find)` and ways up; a choice of files by an argument; an optional one."""
    return package(
        '  <xacro:arg name="model" default="small"/>\n  <xacro:include filename="../parts/$(arg model)/arm.xacro"/>\n'
        + BASE
        + "  <xacro:arm/>\n",
        {"model": "big"},
        parts__big__arm_DOT_xacro=robot(
            '  <xacro:include filename="$(find arm_description)/parts/common.xacro"/>\n'
            + '  <xacro:property name="reach" value="0.9"/>\n  <xacro:macro name="arm">\n    <xacro:lower z="0.5"/>\n'
            + joint("j2", "l1", "l2", '<origin xyz="${reach} 0 0" rpy="0 0 0"/>')
            + "  </xacro:macro>\n"
        ),
        parts__small__arm_DOT_xacro=robot('  <xacro:property name="reach" value="0.6"/>\n'),
        parts__common_DOT_xacro=robot(
            '  <xacro:macro name="lower" params="z">\n'
            + joint("j1", "base", "l1", '<origin xyz="0 0 ${z}" rpy="${HALF} 0 0"/>')
            + '  </xacro:macro>\n  <xacro:property name="HALF" value="1.5707963267948966"/>\n'
        ),
    )


def fixed_too() -> Package:
    """A tool flange and a base that are calibrated, too: fixed joints, of which one is made by a block and one by a parameter."""
    macro = '  <xacro:macro name="arm" params="parent *origin tool:=\'0 0 0.1 0 0 0\'">\n    <xacro:property name="t" value="${tool.split()}"/>\n'
    macro += joint("mount", "${parent}", "arm_base", '<xacro:insert_block name="origin"/>', "fixed")
    macro += joint("j1", "arm_base", "l1", '<origin xyz="0 0 0.3" rpy="0 0 0"/>')
    macro += joint("flange", "l1", "tool0", '<origin xyz="${t[0]} ${t[1]} ${t[2]}" rpy="${t[3]} ${t[4]} ${t[5]}"/>', "fixed")
    return package(
        '  <xacro:arg name="x" default="1.5"/>\n'
        + macro
        + '  </xacro:macro>\n  <link name="world"/>\n'
        + '  <xacro:arm parent="world"><origin xyz="$(arg x) 0 0" rpy="0 0 0"/></xacro:arm>\n',
        joints=("mount", "j1", "flange"),
    )


IDIOMS: dict[str, Callable[[], Package]] = {
    each.__name__: each
    for each in (
        offsets_aside, suffix, exponents, millimetres, joined, choices, parameters, escaped, containers, counted, two_files, nests, fixed_too,
    )
}  # fmt: skip
