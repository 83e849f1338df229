"""ASF and AMC: the same trial as BVH, round trips, malformed files."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from muybridge.errors import FormatError
from muybridge.geometry.numerics.rotations import exp_so3, quat_from_matrix
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.formats.skeletal.amc import read_amc, write_amc
from muybridge.motion.formats.skeletal.asf import find_asf, read_asf
from muybridge.motion.formats.skeletal.bvh import read_bvh
from tests.paths import SHARED

DATA = SHARED / "data" / "motion"
CMU_UNIT = 0.0254 / 0.45

# Joints that stand at one place in both files. The BVH leaves out the lengths of two kinds of bones, thorax and
# wrists: what lies beyond is shifted, so it is compared from the joint behind the omission on.
SAME_PLACE = {
    "root": "Hips", "lfemur": "LeftUpLeg", "ltibia": "LeftLeg", "lfoot": "LeftFoot", "ltoes": "LeftToeBase",
    "rfemur": "RightUpLeg", "rtibia": "RightLeg", "rfoot": "RightFoot", "rtoes": "RightToeBase",
    "lowerback": "LowerBack", "upperback": "Spine", "thorax": "Spine1",
}  # fmt: skip
AFTER_THORAX = {
    "lowerneck": "Neck", "upperneck": "Neck1", "head": "Head", "lclavicle": "LeftShoulder", "lhumerus": "LeftArm",
    "lradius": "LeftForeArm", "lwrist": "LeftHand", "rclavicle": "RightShoulder", "rhumerus": "RightArm",
    "rradius": "RightForeArm", "rwrist": "RightHand",
}  # fmt: skip
AFTER_WRIST = {
    "lhand": ("LeftFingerBase", "lfingers", "LFingers"),
    "rhand": ("RightFingerBase", "rfingers", "RFingers"),
}


def make_motion(frames: int = 20, seed: int = 0, spin: float = 1.0) -> Motion:
    rng = np.random.default_rng(seed)
    skeleton = BODY.skeleton(prior_shape(1.7))
    turn = rng.normal(0, 1, (1, len(skeleton), 3)) * np.linspace(0, spin, frames)[:, None, None]
    root = np.linspace(0, 1, frames)[:, None] * (1.0, -2.0, 0.1) + (0.5, 1.5, 0.95)
    return Motion(skeleton, 120.0, root, quat_from_matrix(exp_so3(turn)))


def test_one_trial_in_two_formats():
    if not DATA.is_dir():
        pytest.skip("../shared/data is not here")
    amc = read_amc(DATA / "01_01.amc")
    bvh = read_bvh(DATA / "01_01.bvh", metres_per_unit=CMU_UNIT)
    assert amc.fps == 120 and len(amc) == 2751 == len(bvh) - 1  # the BVH begins with a T-pose
    one = dict(zip(amc.skeleton.names, amc.joint_positions_world().swapaxes(0, 1), strict=True))
    other = dict(zip(bvh.skeleton.names, bvh.joint_positions_world()[1:].swapaxes(0, 1), strict=True))
    for a, b in SAME_PLACE.items():
        assert np.linalg.norm(one[a] - other[b], axis=1).max() < 1e-3, a
    for a, b in AFTER_THORAX.items():
        difference = (one[a] - one["lowerneck"]) - (other[b] - other["Neck"])
        assert np.linalg.norm(difference, axis=1).max() < 1e-3, a
    for a, (b, c, d) in AFTER_WRIST.items():
        assert np.linalg.norm((one[c] - one[a]) - (other[d] - other[b]), axis=1).max() < 1e-3, c


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 999), frames=st.integers(1, 5), spin=st.sampled_from([0.0, 0.5, 3.0, np.pi / 2]))
def test_round_trip(tmp_path_factory, seed, frames, spin):
    motion = make_motion(frames, seed, spin)
    path = tmp_path_factory.mktemp("amc") / "m.amc"
    assert write_amc(path, motion) == path.with_suffix(".asf")
    back = read_amc(path, fps=motion.fps)
    names = ["root", *motion.skeleton.names[1:]]
    order = [back.skeleton.index(n) for n in names]
    np.testing.assert_allclose(back.forward()[:, order], motion.forward(), atol=1e-7)
    np.testing.assert_allclose(back.skeleton.tips[order], motion.skeleton.tips, atol=1e-9)
    others = set(back.skeleton.names) - set(names)
    assert others and all(n.endswith("_base") for n in others)
    assert sorted(p.name for p in path.parent.iterdir()) == ["m.amc", "m.asf"]


def test_written_again_a_file_is_the_same(tmp_path):
    if not DATA.is_dir():
        pytest.skip("../shared/data is not here")
    (tmp_path / "a.asf").write_text((DATA / "01.asf").read_text())
    lines = (DATA / "01_01.amc").read_text().split("\n")
    (tmp_path / "a_1.amc").write_text("\n".join(lines[: lines.index("21")]) + "\n")
    first = read_amc(tmp_path / "a_1.amc")
    assert len(first) == 20 and find_asf(tmp_path / "a_1.amc").name == "a.asf"
    write_amc(tmp_path / "b.amc", first)
    again = read_amc(tmp_path / "b.amc")
    order = [again.skeleton.index(n) for n in first.skeleton.names]
    np.testing.assert_allclose(again.forward()[:, order], first.forward(), atol=1e-7)


ASF = """# a comment
:version 1.10
:name two
:units
  mass 1.0
  length 0.0254
  angle deg
:documentation
  : none
:root
  order TX TY TZ RX RY RZ
  axis XYZ
  position 0 1 0
  orientation 0 0 0
:bonedata
  begin
    id 1
    name hip
    direction 2 0 0
    length 0.5
    axis 0 0 0 XYZ
  end
  begin
    id 2
    name leg
    direction 0 -1 0
    length 1
    axis 0 90 0 XYZ
    dof rx
    limits (0 90)
  end
:hierarchy
  begin
    root hip
    hip leg
  end
"""
AMC = """:FULLY-SPECIFIED
:DEGREES
1
root 0 0 0 0 0 0
leg 0
2
root 1 0 0 0 0 0
leg 90
"""


def test_axes_units_and_places(tmp_path):
    (tmp_path / "m.asf").write_text(ASF.replace("  : none\n", "  none\n"))
    (tmp_path / "m.amc").write_text(AMC)
    motion = read_amc(tmp_path / "m.amc", fps=30)
    assert motion.skeleton.names == ("root", "hip", "leg") and motion.fps == 30
    # Y up in the file: (x, y, z) -> (x, -z, y); one unit is one metre here; positions are relative to the root's.
    np.testing.assert_allclose(motion.joint_positions_world()[0], [[0, 0, 1], [0, 0, 1], [0.5, 0, 1]], atol=1e-12)
    np.testing.assert_allclose(motion.joint_positions_world()[1], [[1, 0, 1], [1, 0, 1], [1.5, 0, 1]], atol=1e-12)
    # The leg turns about x of its own axes, which is -z of the file, so +y of the world.
    turned = motion.forward()[1, 2, :3, :3] @ motion.skeleton.tips[2]
    np.testing.assert_allclose(turned, np.array([-1.0, 0, 0]), atol=1e-12)
    right = str(np.pi / 2)
    radians = ASF.replace("angle deg", "angle rad").replace("0 90 0 XYZ", f"0 {right} 0 XYZ")
    (tmp_path / "m.asf").write_text(radians.replace("  : none\n", ""))
    (tmp_path / "m.amc").write_text(AMC.replace(":DEGREES\n", ":RADIANS\n").replace("leg 90", f"leg {right}"))
    np.testing.assert_allclose(read_amc(tmp_path / "m.amc").forward(), motion.forward(), atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (ASF, "", "no section :root"),
        ("length 0.0254", "length 0", "line 6: the unit of length"),
        ("angle deg", "angle grad", "line 7: .*deg or rad"),
        ("order TX TY TZ RX RY RZ", "order TX TX", "line 10: .*distinct channels"),
        ("axis XYZ", "axis XYX", "line 11: .*order of axes"),
        ("direction 2 0 0", "direction 2 0", "line 18: the direction has 2 numbers"),
        ("direction 2 0 0", "direction 2 0 nan", "line 18: .*finite"),
        ("direction 2 0 0", "direction 2 0 x", "line 18: .*not a number"),
        ("name leg", "name hip", "line 24: .*appears twice"),
        ("    name leg\n", "", "has no name"),
        ("    hip leg\n", "    hip arm\n", "line 34: the bone 'arm'"),
        ("    hip leg\n", "    leg hip\n", "line 34: the bone 'hip' has two parents"),
        ("    hip leg\n", "", "'leg' has no parent"),
    ],
)
def test_malformed_asf_names_the_line(tmp_path, old, new, says):
    good = ASF.replace("  : none\n", "")
    old = good if old == ASF else old
    assert old in good
    (tmp_path / "bad.asf").write_text(good.replace(old, new, 1))
    with pytest.raises(FormatError, match=says) as raised:
        read_asf(tmp_path / "bad.asf")
    assert "bad.asf" in str(raised.value) and "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        (AMC, "", "has no frame"),
        ("leg 90", "leg", "line 8: the bone 'leg' has 0 numbers, but 1"),
        ("leg 90", "leg ninety", "line 8: .*not a number"),
        ("leg 90", "arm 90", "line 8: the bone 'arm' is unknown"),
        ("leg 90\n", "", "frame 2 ends without the bone 'leg'"),
        ("leg 0\n2\n", "leg 0\n", "line 6: the bone 'root' appears twice"),
        ("1\nroot 0", "root 0", "before any frame"),
    ],
)
def test_malformed_amc_names_the_line(tmp_path, old, new, says):
    (tmp_path / "m.asf").write_text(ASF.replace("  : none\n", ""))
    (tmp_path / "m.amc").write_text(AMC.replace(old, new, 1))
    with pytest.raises(FormatError, match=says) as raised:
        read_amc(tmp_path / "m.amc")
    assert "m.amc" in str(raised.value) and "\n" not in str(raised.value)


def test_missing_skeleton_is_named(tmp_path):
    (tmp_path / "m.amc").write_text(AMC)
    with pytest.raises(FormatError, match="no ASF file beside it"):
        read_amc(tmp_path / "m.amc")
    with pytest.raises(FormatError, match="cannot be read"):
        read_amc(tmp_path / "m.amc", tmp_path / "none.asf")
