"""FBX of other programs: their axes, units, pivots and curves come out as the motion that they show."""

import os
import shutil
import struct
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.errors import FormatError
from muybridge.geometry.numerics.rotations import exp_so3, quat_from_matrix
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.commands.app import run_command
from muybridge.motion.formats.fbx.container import Node, Table, read_fbx_nodes, write_fbx_nodes
from muybridge.motion.formats.fbx.read import read_fbx
from muybridge.motion.formats.fbx.scene import TICKS_A_SECOND
from muybridge.motion.formats.fbx.write import write_fbx
from muybridge.motion.formats.gltf.write import write_glb
from muybridge.motion.formats.registry import read_file

BLENDER = os.environ.get("MUYBRIDGE_BLENDER_PYTHON") or (sys.executable if find_spec("bpy") else None)


def make_motion(frames: int = 40) -> Motion:
    """Every joint turns by itself, as nobody moves, up to three radians."""
    rng = np.random.default_rng(2)
    skeleton = BODY.skeleton(prior_shape(1.7))
    turn = rng.normal(0, 1, (1, len(skeleton), 3)) * np.linspace(0, 3, frames)[:, None, None]
    root = np.linspace(0, 1, frames)[:, None] * (1.0, -2.0, 0.1) + (0.5, 1.5, 0.95)
    return Motion(skeleton, 60.0, root, quat_from_matrix(exp_so3(turn)))


class File:
    """An FBX file in the making."""

    def __init__(self) -> None:
        self.objects, self.links = Node("Objects", (), []), Node("Connections", (), [])
        self.settings = Table()
        self.number = 1000

    def add(self, kind: str, *properties, table: Table | None = None, **children) -> int:
        self.number += 1
        node = self.objects.add(kind, self.number, *properties, children=[])
        if table is not None:
            node.append(table.node)
        for name, value in children.items():
            node.add(name, value)
        return self.number

    def joint(self, name: str, parent: int, place, kind: str = "LimbNode", **vectors) -> int:
        table = Table().line("Lcl Translation", "Lcl Translation", "", "A", *map(float, place))
        if {"PreRotation", "PostRotation", "RotationOrder"} & set(vectors):
            table.line("RotationActive", "bool", "", "", np.int32(1))
        for what, value in vectors.items():
            what = what.replace("Lcl", "Lcl ")
            values = [np.int32(value)] if what == "RotationOrder" else [float(v) for v in value]
            table.line(what, what, "", "A", *values)
        number = self.add("Model", f"{name}\x00\x01Model", kind, table=table)
        self.links.add("C", "OO", number, parent)
        return number

    def layer(self, **values: float) -> int:
        if not hasattr(self, "stack"):
            self.stack = self.add("AnimationStack", "Take\x00\x01AnimStack", "")
        table = Table()
        for name, value in values.items():
            table.number(name, value)
        layer = self.add("AnimationLayer", "Layer\x00\x01AnimLayer", "", table=table)
        self.links.add("C", "OO", layer, self.stack)
        return layer

    def curve(self, layer: int, joint: int, what: str, axis: str, times, values, flag: int = 4, slopes=None) -> None:
        node = self.add("AnimationCurveNode", "R\x00\x01AnimCurveNode", "")
        self.links.add("C", "OO", node, layer)
        self.links.add("C", "OP", node, joint, what)
        data = np.zeros((len(times), 4), np.float32)
        data[:, :2] = 0 if slopes is None else slopes
        curve = self.add(
            "AnimationCurve", "\x00\x01AnimCurve", "",
            KeyTime=np.round(np.array(times) * TICKS_A_SECOND).astype(np.int64),
            KeyValueFloat=np.array(values, np.float32), KeyAttrFlags=np.full(len(times), flag, np.int32),
            KeyAttrDataFloat=data.ravel(), KeyAttrRefCount=np.ones(len(times), np.int32),
        )  # fmt: skip
        self.links.add("C", "OP", curve, node, f"d|{axis}")

    def write(self, path: Path) -> Path:
        settings = Node("GlobalSettings", (), [self.settings.node])
        write_fbx_nodes(path, [settings, self.objects, self.links])
        return path


def test_what_we_write_comes_back(tmp_path):
    motion = make_motion()
    write_fbx(tmp_path / "m.fbx", motion)
    back, notices = read_fbx(tmp_path / "m.fbx")
    assert back.skeleton.names == motion.skeleton.names and back.skeleton.parents == motion.skeleton.parents
    assert back.fps == motion.fps and not notices
    np.testing.assert_allclose(back.skeleton.offsets, motion.skeleton.offsets, atol=1e-9)
    np.testing.assert_allclose(back.skeleton.tips, motion.skeleton.tips, atol=1e-9)
    np.testing.assert_allclose(back.joint_positions_world(), motion.joint_positions_world(), atol=1e-6)
    assert np.abs((back.quat_wxyz * motion.quat_wxyz).sum(-1)).min() > 1 - 1e-9
    # And through the command, as anybody has it.
    assert run_command(["convert", str(tmp_path / "m.fbx"), str(tmp_path / "m.bvh")]) == 0
    bvh = read_file(tmp_path / "m.bvh").motion
    order = [bvh.skeleton.index(n) for n in motion.skeleton.names]
    np.testing.assert_allclose(bvh.joint_positions_world()[:, order], motion.joint_positions_world(), atol=1e-5)


def test_axes_units_and_what_stands_above(tmp_path):
    file = File()
    file.settings.integer("UpAxis", 2).integer("UpAxisSign", 1).integer("CoordAxis", 0).integer("CoordAxisSign", 1)
    file.settings.number("UnitScaleFactor", 2.54)  # inches
    file.settings.integer("TimeMode", 11, "enum")
    null = file.joint("rig", 0, (10, 0, 0), kind="Null", LclRotation=(0, 0, 90), LclScaling=(2, 2, 2))
    hips = file.joint("hips", null, (0, 5, 30))
    file.joint("spine", hips, (0, 0, 10))
    motion, _ = read_fbx(file.write(tmp_path / "a.fbx"))
    assert motion.fps == 24 and len(motion) == 1 and motion.skeleton.names == ("hips", "spine")
    expected = np.array([[10 - 10, 0, 60], [0, 0, 80]]) * 0.0254  # (0, 5) turned by 90 degrees is (-5, 0)
    np.testing.assert_allclose(motion.joint_positions_world()[0], expected, atol=1e-12)
    file = File()  # nothing said: centimetres, Y up
    hips = file.joint("hips", 0, (1, 90, 3))
    file.joint("spine", hips, (0, 10, 0))
    motion, _ = read_fbx(file.write(tmp_path / "b.fbx"))
    np.testing.assert_allclose(motion.joint_positions_world()[0], [[0.01, -0.03, 0.9], [0.01, -0.03, 1.0]], atol=1e-12)


def test_orders_pivots_and_rotations_before_and_after(tmp_path):
    """Against the product of matrices that Autodesk documents."""
    rng = np.random.default_rng(5)
    for order, axes in enumerate(("xyz", "xzy", "yzx", "yxz", "zxy", "zyx")):
        file = File()
        file.settings.integer("UpAxis", 2).number("UnitScaleFactor", 100.0)
        file.settings.integer("TimeMode", 3, "enum")
        named = ("RotationOffset", "RotationPivot", "ScalingOffset", "ScalingPivot")
        vectors = {n: rng.uniform(-1, 1, 3) for n in named}
        turns = {n: rng.uniform(-90, 90, 3) for n in ("PreRotation", "PostRotation", "LclRotation")}
        place, size = rng.uniform(-1, 1, 3), 1.7
        one = file.joint("one", 0, place, RotationOrder=order, LclScaling=(size,) * 3, **vectors, **turns)
        file.joint("two", one, (0.1, 0.2, 0.3))
        motion, _ = read_fbx(file.write(tmp_path / "m.fbx"))

        def moved(v):
            out = np.eye(4)
            out[:3, 3] = v
            return out

        def turned(degrees, axes="xyz"):
            out = np.eye(4)
            out[:3, :3] = Rotation.from_euler(axes, degrees, degrees=True).as_matrix()
            return out

        pivot, about = vectors["RotationPivot"], vectors["ScalingPivot"]
        local = turns["LclRotation"][["xyz".index(a) for a in axes]]
        matrix = (
            moved(place) @ moved(vectors["RotationOffset"]) @ moved(pivot) @ turned(turns["PreRotation"])
            @ turned(local, axes) @ np.linalg.inv(turned(turns["PostRotation"])) @ moved(-pivot)
            @ moved(vectors["ScalingOffset"]) @ moved(about) @ np.diag([size] * 3 + [1]) @ moved(-about)
        )  # fmt: skip
        expected = [matrix[:3, 3], (matrix @ [0.1, 0.2, 0.3, 1])[:3]]
        np.testing.assert_allclose(motion.joint_positions_world()[0], expected, atol=1e-9)


@pytest.mark.parametrize(
    ("flag", "slopes", "expected"),
    [
        (2, None, [0, 0, 0, 0, 40]),
        (4, None, [0, 10, 20, 30, 40]),
        (0x408, (0.0, 0.0), [0, 6.25, 20, 33.75, 40]),  # flat at both ends
        (0x408, (40.0, 40.0), [0, 10, 20, 30, 40]),
        (0x108, (7.0, 7.0), [0, 10, 20, 30, 40]),  # the program's own tangents: two keys make a line
    ],
)
def test_curves_between_keys(tmp_path, flag, slopes, expected):
    file = File()
    file.settings.integer("TimeMode", 14, "enum").number("CustomFrameRate", 4.0)
    hips = file.joint("hips", 0, (0, 100, 0))
    file.joint("spine", hips, (0, 0, 10))
    file.curve(file.layer(), hips, "Lcl Rotation", "X", [0.5, 1.5], [0.0, 40.0], flag, slopes)
    motion, _ = read_fbx(file.write(tmp_path / "m.fbx"))
    assert motion.fps == 4 and len(motion) == 5
    spine = (motion.joint_positions_world()[:, 1] - motion.joint_positions_world()[:, 0]) / 0.1
    # The file's X is ours; its Z, where the spine lies, is our -Y, and turns to its -Y, our -Z.
    angles = np.degrees(np.arctan2(-spine[:, 2], -spine[:, 1]))
    np.testing.assert_allclose(angles, expected, atol=1e-4)


def test_the_program_s_own_tangents_do_not_overshoot(tmp_path):
    file = File()
    file.settings.integer("TimeMode", 1, "enum")
    hips = file.joint("hips", 0, (0, 100, 0))
    file.curve(file.layer(), hips, "Lcl Translation", "Y", np.arange(5), [0, 0, 50, 50, 0], 0x108)
    motion, _ = read_fbx(file.write(tmp_path / "m.fbx"))
    height = motion.root_positions_world[:, 2]
    assert len(motion) == 481 and height.min() > -1e-9 and height.max() < 0.5 + 1e-9
    np.testing.assert_allclose(height[::120], [0, 0, 0.5, 0.5, 0], atol=1e-9)


def test_two_skeletons_ends_and_names(tmp_path):
    file = File()
    for prefix, count in (("a", 2), ("b", 4)):
        parent = file.joint(f"{prefix}:hips", 0, (0, 90, 0))
        for _ in range(count):
            parent = file.joint("bone", parent, (0, 10, 0))
        file.joint("bone_End", parent, (0, 7, 0))
    motion, notices = read_fbx(file.write(tmp_path / "m.fbx"))
    assert motion.skeleton.names == ("b:hips", "bone", "bone.001", "bone.002", "bone.003")
    np.testing.assert_allclose(motion.skeleton.tips[-1], [0, 0, 0.07], atol=1e-12)
    assert np.isnan(motion.skeleton.tips[:-1]).all()
    assert len(notices) == 1 and "a:hips" in notices[0]
    assert read_file(tmp_path / "m.fbx").notices == notices


def test_sliding_joints_and_several_roots(tmp_path):
    file = File()
    file.settings.integer("TimeMode", 14, "enum").number("CustomFrameRate", 4.0)
    rig = file.joint("rig", 0, (0, 50, 0), kind="Null")
    hips = file.joint("hips", rig, (0, 40, 0), PreRotation=(0, 90, 0))
    spine = file.joint("spine", hips, (0, 10, 0))
    prop = file.joint("prop", rig, (100, 0, 0))
    layer = file.layer()
    file.curve(layer, spine, "Lcl Translation", "X", [0, 1], [10, 20])
    file.curve(layer, prop, "Lcl Translation", "Y", [0, 1], [0, 40])
    motion, _ = read_fbx(file.write(tmp_path / "m.fbx"))
    assert motion.skeleton.names == ("hips", "spine", "prop") and motion.skeleton.parents == (-1, 0, -1)
    assert motion.skeleton.sliding == (1, 2) and len(motion) == 5
    share = np.linspace(0, 1, 5)[:, None]
    at = motion.joint_positions_world()
    # The hips' X is the file's -Z, our Y.
    np.testing.assert_allclose(at[:, 0], np.tile([0, 0, 0.9], (5, 1)), atol=1e-7)
    np.testing.assert_allclose(at[:, 1], [0, 0.1, 1.0] + share * [0, 0.1, 0], atol=1e-7)
    np.testing.assert_allclose(at[:, 2], [1, 0, 0.5] + share * [0, 0, 0.4], atol=1e-7)
    write_fbx(tmp_path / "again.fbx", motion)
    back, notices = read_fbx(tmp_path / "again.fbx")
    assert back.skeleton.names == motion.skeleton.names and not notices
    np.testing.assert_allclose(back.joint_frames(), motion.joint_frames(), atol=1e-6)


def test_a_clip_is_chosen_by_name_or_number(tmp_path):
    file = File()
    file.settings.integer("TimeMode", 14, "enum").number("CustomFrameRate", 4.0)
    hips = file.joint("hips", 0, (0, 100, 0))
    file.joint("spine", hips, (0, 0, 10))
    for height in (50, 80):
        if hasattr(file, "stack"):
            del file.stack
        file.curve(file.layer(), hips, "Lcl Translation", "Y", [0, 1], [100, height])
    path = file.write(tmp_path / "m.fbx")
    for clip, height in ((None, 0.5), (0, 0.5), ("Take", 0.5), (1, 0.8), ("Take.001", 0.8)):
        motion, notices = read_fbx(path, clip)
        assert motion.root_positions_world[-1, 2] == pytest.approx(height)
        assert notices == (("m.fbx: the first of its 2 clips was read, 'Take'",) if clip is None else ())
    with pytest.raises(FormatError, match=r"has no clip 'Run'; its clips are: 0 'Take', 1 'Take\.001'; pass `clip`"):
        read_fbx(path, "Run")


@pytest.mark.parametrize("unheard", [{"Mute": 1}, {"Weight": 0}, {}])
def test_layers_that_do_not_count_are_left_out(tmp_path, unheard):
    file = File()
    hips = file.joint("hips", 0, (0, 100, 0))
    file.joint("spine", hips, (0, 0, 10))
    file.curve(file.layer(**({} if unheard else {"Solo": 1})), hips, "Lcl Translation", "Y", [0, 1], [100, 50])
    file.curve(file.layer(**unheard), hips, "Lcl Translation", "Y", [0, 1], [100, 300])
    motion, _ = read_fbx(file.write(tmp_path / "m.fbx"))
    assert motion.root_positions_world[-1, 2] == pytest.approx(0.5)


def test_what_cannot_be_read_is_said(tmp_path):
    def refused(file: File, words: str) -> None:
        with pytest.raises(FormatError, match=words) as caught:
            read_fbx(file.write(tmp_path / "m.fbx"))
        assert "m.fbx" in str(caught.value)

    file = File()
    file.joint("box", 0, (0, 0, 0), kind="Mesh")
    refused(file, "no skeleton")
    file = File()
    file.joint("hips", 0, (0, 0, 0), LclScaling=(1, 2, 1))
    refused(file, "'hips' stretches")
    file = File()
    hips = file.joint("hips", 0, (0, 0, 0))
    for _ in range(2):
        file.curve(file.layer(), hips, "Lcl Rotation", "X", [0, 1], [10, 20])
    refused(file, "several layers.*Merge Layers")
    file = File()
    hips = file.joint("hips", 0, (0, 0, 0))
    file.links.add("C", "OO", hips, file.joint("spine", hips, (0, 10, 0)))
    refused(file, "its own ancestor")
    for content, words in (
        (b"; FBX 7.3.0 project file\nFBXHeaderExtension:  {\n", "'FBXHeaderExtension' is not closed"),
        (b"FBXHeaderExtension: {\n FBXVersion: 6100\n}\n", "version 6.1; .* is read; open it in Blender 4.5"),
        (b"something else", "no FBX file"),
        (b"Kaydara FBX Binary  \x00\x1a\x00" + struct.pack("<I", 6100), "version 6.1"),
        (b"Kaydara FBX Binary  \x00\x1a\x00" + struct.pack("<I", 7400) + b"\x01", "damaged"),
    ):
        (tmp_path / "t.fbx").write_bytes(content)
        with pytest.raises(FormatError, match=words):
            read_fbx(tmp_path / "t.fbx")
    with pytest.raises(FormatError, match=r"absent.fbx"):
        read_fbx(tmp_path / "absent.fbx")


def test_long_files_have_wider_heads(tmp_path):
    """From version 7500 on sizes are 64 bits."""
    inner = b"hello".ljust(5)
    text = b"S" + struct.pack("<I", len(inner)) + inner
    size = 25 + 4 + len(text)
    start = len(b"Kaydara FBX Binary  \x00\x1a\x00") + 4
    node = struct.pack("<QQQB", start + size, 1, len(text), 4) + b"Name" + text
    (tmp_path / "w.fbx").write_bytes(b"Kaydara FBX Binary  \x00\x1a\x00" + struct.pack("<I", 7700) + node + bytes(25))
    top = read_fbx_nodes(tmp_path / "w.fbx")
    assert [n.name for n in top.children] == ["Name"] and top.children[0].properties == ("hello",)


def test_a_small_file_that_unpacks_to_a_huge_one_is_refused(tmp_path):
    import zlib

    packed = zlib.compress(bytes(50_000_000))
    array = b"d" + struct.pack("<III", 10, 1, len(packed)) + packed
    node = struct.pack("<IIIB", 27 + 13 + 1 + len(array), 1, len(array), 1) + b"A" + array
    (tmp_path / "z.fbx").write_bytes(b"Kaydara FBX Binary  \x00\x1a\x00" + struct.pack("<I", 7400) + node + bytes(13))
    with pytest.raises(FormatError, match="array of 10 values"):
        read_fbx(tmp_path / "z.fbx")


@pytest.mark.parametrize("suffix", ["", "-z"])
def test_what_blender_writes_is_where_blender_has_it(tmp_path, suffix):
    if not BLENDER or not shutil.which(BLENDER):
        pytest.skip("Blender's Python module is not here: pip install bpy, or set MUYBRIDGE_BLENDER_PYTHON")
    motion = make_motion()
    write_glb(tmp_path / "m.glb", motion)
    script = Path(__file__).with_name("blender_fbx.py")
    done = subprocess.run([BLENDER, script, tmp_path / "m.glb", str(motion.fps), tmp_path / "b"],
                          capture_output=True, text=True, timeout=300)  # fmt: skip
    assert done.returncode == 0, done.stderr
    there = np.load(tmp_path / "b.npz")
    back, notices = read_fbx(tmp_path / f"b{suffix}.fbx")
    assert set(there["names"]) == set(back.skeleton.names) and back.fps == motion.fps and not notices
    order = [back.skeleton.index(n) for n in there["names"]]
    np.testing.assert_allclose(back.joint_positions_world()[:, order], there["places"], atol=1e-5)
