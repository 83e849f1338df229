"""Two humanoid robots of our own, written for tests: one as MJCF and one as URDF, unlike each other in every way that a
file may differ: joints, their order, axes, units of angles, classes, fixed links, mimicked joints."""

from pathlib import Path

# 19 joints, waist that only turns, no wrists, angles in degrees, classes, Euler angles, capsules from point to point.
# Legs come right before left, arms before legs; the body faces +X.
_LEG = """
<body name="{s}_hip_a" pos="0 {y}0.09 -0.05" childclass="strong">
  <joint name="{s}_hip_turn" axis="0 0 1" range="-30 30"/>
  <inertial pos="0 0 -0.02" mass="1.5" diaginertia="0.01 0.01 0.01"/>
  <body name="{s}_hip_b" pos="0 0 -0.06">
    <joint name="{s}_hip_side" axis="1 0 0" range="-25 25"/>
    <inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
    <body name="{s}_thigh">
      <joint name="{s}_hip_swing" axis="0 1 0" range="-90 60"/>
      <inertial pos="0 0 -0.2" mass="4" diaginertia="0.05 0.05 0.01"/>
      <geom type="capsule" fromto="0 0 -0.06 0 0 -0.34" size="0.055"/>
      <body name="{s}_shank" pos="0 0 -0.4">
        <joint name="{s}_knee" axis="0 1 0" range="-4 120"/>
        <geom type="capsule" fromto="0 0 -0.06 0 0 -0.32" size="0.045"/>
        <body name="{s}_sole" pos="0 0 -0.4">
          <joint name="{s}_ankle" axis="0 1 0" range="-50 35"/>
          <geom type="box" pos="0.04 0 -0.05" size="0.12 0.045 0.015"/>
        </body>
      </body>
    </body>
  </body>
</body>"""
_ARM = """
<body name="{s}_arm_a" pos="0 {y}0.16 0.42">
  <joint name="{s}_arm_swing" axis="0 1 0" range="-165 165"/>
  <body name="{s}_arm_b" pos="0 {y}0.05 0" euler="{t}10 0 0">
    <joint name="{s}_arm_side" axis="1 0 0" range="{range}"/>
    <body name="{s}_arm_c" pos="0 0 -0.1" euler="{u}10 0 0">
      <joint name="{s}_arm_turn" axis="0 0 1" range="-75 255" ref="0"/>
      <geom type="capsule" fromto="0 0 0.06 0 0 -0.12" size="0.04"/>
      <body name="{s}_forearm" pos="0 0 -0.18">
        <joint name="{s}_elbow" axis="0 1 0" range="-140 70"/>
        <geom type="capsule" fromto="0.05 0 0 0.24 0 0" size="0.035"/>
      </body>
    </body>
  </body>
</body>"""
_TALL = """<mujoco model="tall">
<compiler angle="degree" eulerseq="XYZ" boundmass="0.01" boundinertia="0.001"/>
<default>
  <joint damping="1"/>
  <default class="strong"><joint armature="0.1"/><geom contype="1"/></default>
  <default class="turning"><joint axis="0 0 1" range="-130 130"/></default>
</default>
<worldbody>
  <geom name="floor" type="plane" size="5 5 1"/>
  <body name="base" pos="0 0 1.0">
    <freejoint name="floating"/>
    <inertial pos="0 0 0" mass="5" diaginertia="0.05 0.05 0.05"/>
    <geom type="sphere" size="0.08"/>
    <frame pos="0 0 0.02">
      <body name="trunk" pos="0 0 0.04">
        <joint name="waist" class="turning"/>
        <geom type="capsule" fromto="0 0 0.1 0 0 0.38" size="0.1"/>
        {arms}
      </body>
    </frame>
    {legs}
  </body>
</worldbody>
</mujoco>
"""


def write_tall(folder: Path) -> Path:
    """A robot of 1.5 m as MJCF; its legs and arms are in files of their own."""
    right = {"s": "right", "y": "-", "t": "-", "u": "", "range": "-175 18"}
    left = {"s": "left", "y": "", "t": "", "u": "-", "range": "-18 175"}
    arms = "".join(_ARM.format(**side) for side in (right, left))
    legs = "".join(_LEG.format(**side) for side in (right, left))
    (folder / "legs.xml").write_text(f"<mujoco>{legs}</mujoco>", encoding="utf-8")
    path = folder / "tall.xml"
    path.write_text(_TALL.format(arms=arms, legs='<include file="legs.xml"/>'), encoding="utf-8")
    return path


def write_small(folder: Path, left: str = "limb1", right: str = "limb2") -> Path:
    """A robot of 0.6 m as URDF that faces -Y: no waist, hips of another order, a head, fingers that follow, slow
    joints, no shapes but on the feet, and names that say nothing."""
    links, joints = [_link("base", 2.0)], []

    def joint(name: str, parent: str, child: str, place: str, axis: str, limits: str, kind: str = "revolute",
              rpy: str = "0 0 0", more: str = "") -> None:  # fmt: skip
        limit = (
            f'<limit lower="{limits.split()[0]}" upper="{limits.split()[1]}" effort="9" velocity="9"/>'
            if limits
            else ""
        )
        axis = f'<axis xyz="{axis}"/>' if axis else ""
        joints.append(f'<joint name="{name}" type="{kind}"><origin xyz="{place}" rpy="{rpy}"/><parent link="{parent}"/>'
                      f'<child link="{child}"/>{axis}{limit}{more}</joint>')  # fmt: skip

    for side, x in ((left, 1), (right, -1)):
        for k, mass in enumerate((0.3, 0.2, 0.5, 0.4, 0.1, 0.2)):
            links.append(_link(f"{side}_l{k}", mass, "0 0 -0.03", foot=k == 5))
        for k, mass in enumerate((0.1, 0.1, 0.2, 0.2)):
            links.append(_link(f"{side}_a{k}", mass, "0 0 -0.05"))
        links += [_link(f"{side}_f1", 0.01), _link(f"{side}_f2", 0.01)]
        hips = ("-0.8 0.4", "-0.4 0.8")[x < 0]
        joint(f"{side}_j0", "base", f"{side}_l0", f"{0.05 * x} 0 -0.06", "0 1 0", hips)
        joint(f"{side}_j1", f"{side}_l0", f"{side}_l1", "0 0 0", "1 0 0", "-1.7 0.5")
        joint(f"{side}_j2", f"{side}_l1", f"{side}_l2", "0 0 -0.01", "0 0 1", "-0.7 0.7")
        joint(f"{side}_j3", f"{side}_l2", f"{side}_l3", "0 0 -0.12", "1 0 0", "-0.05 2.2")
        joint(f"{side}_j4", f"{side}_l3", f"{side}_l4", "0 0 -0.12", "1 0 0", "-0.9 0.9")
        joint(f"{side}_j5", f"{side}_l4", f"{side}_l5", "0 0 0", "0 1 0", "-0.5 0.5")
        joint(f"{side}_k0", "base", f"{side}_a0", f"{0.07 * x} 0 0.17", "1 0 0", "-3 3")
        joint(f"{side}_k1", f"{side}_a0", f"{side}_a1", f"{0.03 * x} 0 0", "0 1 0", ("-3 0.2", "-0.2 3")[x < 0])
        joint(f"{side}_k2", f"{side}_a1", f"{side}_a2", "0 0 -0.02", "0 0 1", "-1.5 1.5")
        joint(f"{side}_k3", f"{side}_a2", f"{side}_a3", "0 0 -0.09", "-1 0 0", "-0.05 2.4")
        joint(f"{side}_m1", f"{side}_a3", f"{side}_f1", "0.02 0 -0.1", "0 1 0", "0 1")
        joint(f"{side}_m2", f"{side}_a3", f"{side}_f2", "-0.02 0 -0.1", "0 1 0", "-1 0",
              more=f'<mimic joint="{side}_m1" multiplier="-1" offset="0"/>')  # fmt: skip
    links.append(_link("skull", 0.4, "0 0 0.05"))
    joint("nod", "base", "skull", "0 0 0.2", "1 0 0", "-0.6 0.6", rpy="0 0 0.1")
    path = folder / "small.urdf"
    path.write_text(f'<robot name="small">{"".join(links)}{"".join(joints)}</robot>', encoding="utf-8")
    return path


def _link(name: str, mass: float, centre: str = "0 0 0", foot: bool = False) -> str:
    shape = ('<collision><origin xyz="0 -0.02 -0.03"/><geometry><box size="0.05 0.12 0.02"/></geometry></collision>'
             if foot else "")  # fmt: skip
    return (f'<link name="{name}"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>'
            '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
            f"{shape}</link>")  # fmt: skip
