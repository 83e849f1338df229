"""FBX as text: what a binary file holds, read from its other form."""

from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import FormatError
from muybridge.motion.character.posing import pose_meshes
from muybridge.motion.character.read import read_character
from muybridge.motion.character.write import write_character_clip
from muybridge.motion.formats.fbx.container import Node, read_fbx_nodes
from muybridge.motion.formats.fbx.read import read_fbx
from muybridge.motion.formats.fbx.write import write_fbx
from tests.motion.formats.test_fbx_read import File
from tests.motion.formats.test_gltf import make_motion


def as_text(node: Node, depth: int = 0) -> str:
    """A node as Autodesk's exporter writes it."""
    values, indent = [], "\t" * depth
    for value in node.properties:
        if isinstance(value, np.ndarray):
            if node.name == "KeyAttrDataFloat":
                value = value.astype(np.float32).view(np.int32)
            numbers = ",".join(map(str, value.tolist()))
            return f"{indent}{node.name}: *{value.size} {{\n{indent}\ta: {numbers}\n{indent}}} \n"
        if isinstance(value, str) and "\x00\x01" in value:
            name, _, kind = value.partition("\x00\x01")
            values.append(f'"{kind}::{name}"')
        elif isinstance(value, bool):
            values.append("TF"[not value])
        elif isinstance(value, str | bytes):
            values.append('"' + (value if isinstance(value, str) else "").replace('"', "&quot;") + '"')
        else:
            values.append(f"{value:.15g}")
    within = (
        "" if node.children is None else " {\n" + "".join(as_text(c, depth + 1) for c in node.children) + indent + "}"
    )
    return f"{indent}{node.name}: {', '.join(values)}{within}\n"


def text_file(binary: Path, path: Path) -> Path:
    top = read_fbx_nodes(binary)
    head = "; FBX 7.4.0 project file\n; ---\n\n"
    if not top.all("FBXHeaderExtension"):
        head += "FBXHeaderExtension: {\n\tFBXVersion: 7400\n}\n"
    path.write_text(head + "".join(as_text(n) for n in top.children), encoding="utf-8")
    return path


def test_a_file_as_text_is_the_file_as_binary(tmp_path):
    write_fbx(tmp_path / "m.fbx", make_motion(4))
    path = text_file(tmp_path / "m.fbx", tmp_path / "t.fbx")
    (binary, _), (text, notices) = read_fbx(tmp_path / "m.fbx"), read_fbx(path)
    assert text.skeleton.names == binary.skeleton.names and text.fps == binary.fps and notices == ()
    np.testing.assert_allclose(text.joint_frames(), binary.joint_frames(), atol=1e-6)
    one, other = read_character(tmp_path / "m.fbx"), read_character(path)
    np.testing.assert_allclose(
        pose_meshes(other, other.motion)[0], pose_meshes(one, one.motion)[0], atol=1e-6,
    )  # fmt: skip
    with pytest.raises(FormatError, match="t.fbx is FBX as text, which gets no clip; open it in Blender"):
        write_character_clip(other, other.motion, tmp_path / "out.fbx", "new")


def test_tangents_are_the_bits_that_the_text_has(tmp_path):
    file = File()
    hips = file.joint("mixamorig:Hips", 0, (0, 100, 0))
    file.curve(file.layer(), hips, "Lcl Translation", "X", [0, 1], [0, 100], flag=8 | 0x400, slopes=[[300, 0], [0, 0]])
    file.write(tmp_path / "m.fbx")
    text_file(tmp_path / "m.fbx", tmp_path / "t.fbx")
    binary, text = read_fbx(tmp_path / "m.fbx")[0], read_fbx(tmp_path / "t.fbx")[0]
    assert text.skeleton.names == ("mixamorig:Hips",)
    np.testing.assert_allclose(text.root_positions_world, binary.root_positions_world, atol=1e-9)
    assert np.abs(np.diff(binary.root_positions_world[:, 0], 2)).max() > 1e-3


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [("*", "*9", "a list of 9"), ("}", "} }", "never opened"), ("FBXVersion: 7400", "FBXVersion: 6100", "version 6.1"),
     ('"Model::', '"Model::\n@', "no skeleton|damaged|line")],
)  # fmt: skip
def test_damaged_text_is_refused(tmp_path, old, new, says):
    write_fbx(tmp_path / "m.fbx", make_motion(2))
    path = text_file(tmp_path / "m.fbx", tmp_path / "t.fbx")
    path.write_text(path.read_text().replace(old, new, 1) if "Model" not in old else path.read_text() + "@")
    with pytest.raises(FormatError, match=says) as raised:
        read_fbx(path)
    assert "\n" not in str(raised.value)
