"""Meshes read from files of all formats, and written with a skeleton."""

import io
import json
import struct
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from muybridge.errors import FormatError
from muybridge.motion.character import pose_meshes, read_character
from muybridge.motion.character.character import Morph
from muybridge.motion.character.meshes import (
    BoundMesh,
    Look,
    Picture,
    StaticMesh,
    Surface,
    read_mesh,
    write_skinned_glb,
)
from muybridge.motion.character.meshes.read import MESH_SUFFIXES
from muybridge.motion.character.rigging import rig_mesh
from muybridge.motion.formats.gltf.container import Buffer, pack_glb
from tests.motion.character.rigging.figures import capsule, person
from tests.motion.formats.test_fbx_read import File

trimesh = pytest.importorskip("trimesh")
GLTF = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # glTF from world


def png() -> bytes:
    out = io.BytesIO()
    Image.new("RGB", (4, 4), (200, 40, 10)).save(out, "PNG")
    return out.getvalue()


def glb(path, vertices, triangles, node=None, extra=None, edit=None):
    """A GLB of one mesh in the axes of glTF, with texture coordinates and a texture."""
    buffer = Buffer()
    attributes = {"POSITION": buffer.add(vertices @ GLTF.T, "VEC3", bounds=True),
                  "TEXCOORD_0": buffer.add(vertices[:, [0, 2]], "VEC2")} | (extra or {})  # fmt: skip
    indices = buffer.add(triangles.reshape(-1), "SCALAR", 5123)
    image = png()
    buffer.data += b"\0" * (-len(buffer.data) % 4)
    buffer.views.append({"buffer": 0, "byteOffset": len(buffer.data), "byteLength": len(image)})
    buffer.data += image
    document = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1], "scale": [2, 2, 2]}, {"name": "body", "mesh": 0} | (node or {})],
        "meshes": [{"name": "body", "primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}],
        "materials": [{"name": "skin", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
                       "extensions": {"KHR_materials_specular": {"specularFactor": 0.2}}}],
        "textures": [{"source": 0, "sampler": 0}], "samplers": [{"wrapS": 33071}],
        "images": [{"mimeType": "image/png", "bufferView": len(buffer.views) - 1}],
        "extensionsUsed": ["KHR_materials_specular"],
        "accessors": buffer.accessors, "bufferViews": buffer.views, "buffers": [{"byteLength": len(buffer.data)}],
    }  # fmt: skip
    if edit is not None:
        edit(document)
    path.write_bytes(pack_glb(document, bytes(buffer.data)))
    return path


@pytest.fixture(scope="module")
def body():
    return person(40.0)


def test_transforms_of_nodes_are_applied_and_materials_kept(tmp_path, body):
    vertices, triangles, _ = body
    path = glb(
        tmp_path / "a.glb", vertices, triangles, {"rotation": [0, 2**-0.5, 0, 2**-0.5], "translation": [1, 0, 0]}
    )
    mesh = read_mesh(path)
    turned = np.stack([-vertices[:, 1], vertices[:, 0], vertices[:, 2]], axis=1)
    assert np.allclose(mesh.vertices, 2 * (turned + [1, 0, 0]), atol=1e-5)
    assert np.array_equal(mesh.triangles, triangles)
    assert np.allclose(mesh.surfaces[0].attributes["TEXCOORD_0"], vertices[:, [0, 2]], atol=1e-6)
    assert mesh.look.materials[0]["extensions"]["KHR_materials_specular"] == {"specularFactor": 0.2}
    assert mesh.look.pictures[0].data == png() and mesh.look.samplers == ({"wrapS": 33071},)


def test_a_node_that_mirrors_turns_its_faces(tmp_path, body):
    vertices, triangles, _ = body
    mesh = read_mesh(glb(tmp_path / "a.glb", vertices, triangles, {"scale": [-1, 1, 1]}))
    assert np.allclose(mesh.vertices, 2 * vertices * [-1, 1, 1], atol=1e-5)
    assert np.array_equal(mesh.triangles, triangles[:, ::-1])
    assert not rig_mesh(mesh.vertices, mesh.triangles).inside_out


def test_a_mesh_with_a_skin_is_sent_to_retarget(tmp_path, body):
    def skin(document):
        document["skins"], document["nodes"][1]["skin"] = [{"joints": [0]}], 0

    with pytest.raises(FormatError, match="has a skin already") as raised:
        read_mesh(glb(tmp_path / "a.glb", *body[:2], edit=skin))
    assert raised.value.remedy == "has_skin"


def test_draco_is_named(tmp_path, body):
    def draco(document):
        document["meshes"][0]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": {}}

    with pytest.raises(FormatError, match="compressed by Draco"):
        read_mesh(glb(tmp_path / "a.glb", *body[:2], edit=draco))


def test_an_obj_keeps_texture_coordinates_and_materials(tmp_path, body):
    vertices, triangles, _ = body
    lines = ["mtllib hero.mtl", *(f"v {x} {y} {z}" for x, y, z in vertices),
             *(f"vt {x} {z}" for x, _, z in vertices), "usemtl skin"]  # fmt: skip
    lines += [f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in triangles[:2000] + 1]
    lines += ["usemtl cloth", *(f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in triangles[2000:] + 1)]
    (tmp_path / "hero.obj").write_text("\n".join(lines))
    (tmp_path / "hero.mtl").write_text("newmtl skin\nKd 1 1 1\nmap_Kd skin.png\nnewmtl cloth\nKd 0.5 0 0\nd 0.5\n")
    (tmp_path / "skin.png").write_bytes(png())
    mesh = read_mesh(tmp_path / "hero.obj")
    names = [mesh.look.materials[s.material]["name"] for s in mesh.surfaces]
    assert sorted(names) == ["cloth", "skin"]
    assert sum(len(s.triangles) for s in mesh.surfaces) == len(triangles)
    for surface in mesh.surfaces:
        uv = surface.attributes["TEXCOORD_0"]
        assert np.allclose(uv[:, 0], surface.positions[:, 0]) and np.allclose(1 - uv[:, 1], surface.positions[:, 2])
    cloth = mesh.look.materials[1]
    assert cloth["alphaMode"] == "BLEND" and cloth["pbrMetallicRoughness"]["baseColorFactor"][0] == pytest.approx(
        0.214, abs=1e-3
    )
    assert mesh.look.pictures == (Picture("skin.png", png(), "image/png"),)


def test_missing_materials_and_textures_are_notices(tmp_path, body):
    trimesh.Trimesh(*body[:2], process=False).export(tmp_path / "a.obj", include_texture=False)
    text = (tmp_path / "a.obj").read_text()
    (tmp_path / "a.obj").write_text("mtllib gone.mtl\n" + text)
    assert any("gone.mtl were not found" in note for note in read_mesh(tmp_path / "a.obj").notices)
    (tmp_path / "gone.mtl").write_text("newmtl a\nmap_Kd nothing.png\n")
    assert any("nothing.png was not found" in note for note in read_mesh(tmp_path / "a.obj").notices)


@pytest.mark.parametrize("suffix", [".ply", ".stl"])
def test_files_of_points_and_faces(tmp_path, body, suffix):
    vertices, triangles, _ = body
    path = tmp_path / f"a{suffix}"
    trimesh.Trimesh(vertices, triangles, process=False).export(path)
    mesh = read_mesh(path)
    assert np.allclose(mesh.vertices[mesh.triangles], vertices[triangles], atol=1e-5)


def test_a_ply_keeps_the_colours_of_vertices(tmp_path, body):
    vertices, triangles, _ = body
    colours = np.tile([255, 0, 51, 255], (len(vertices), 1)).astype(np.uint8)
    trimesh.Trimesh(vertices, triangles, vertex_colors=colours, process=False).export(tmp_path / "a.ply")
    assert np.allclose(read_mesh(tmp_path / "a.ply").surfaces[0].attributes["COLOR_0"], [1, 0, 0.2, 1])


BAD = {
    "no faces": (lambda v, t: (v, t[:0]), "no faces"),
    "one triangle": (lambda v, t: (v, t[:1]), "1 triangles"),
    "not finite": (lambda v, t: (np.where(np.arange(len(v))[:, None] == 7, np.nan, v), t), "not finite"),
}


@pytest.mark.parametrize("what", BAD)
def test_bad_meshes_are_refused_in_one_line(tmp_path, body, what):
    change, said = BAD[what]
    vertices, triangles = change(*body[:2])
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in triangles + 1]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    with pytest.raises(FormatError, match=said) as raised:
        read_mesh(tmp_path / "a.obj")
    assert "\n" not in str(raised.value) and "a.obj" in str(raised.value)


def test_other_files_are_refused(tmp_path):
    (tmp_path / "a.txt").write_text("x")
    with pytest.raises(FormatError, match=r"valid are \.glb"):
        read_mesh(tmp_path / "a.txt")
    with pytest.raises(FormatError, match="no such file"):
        read_mesh(tmp_path / "a.obj")
    (tmp_path / "b.glb").write_bytes(b"glTF\2\0\0\0\x10\0\0\0junk")
    with pytest.raises(FormatError, match="b.glb"):
        read_mesh(tmp_path / "b.glb")
    for content in (b"", b"\n\n", bytes(64)):  # a file that was never written to its end
        (tmp_path / "c.glb").write_bytes(content)
        with pytest.raises(FormatError, match=r"c\.glb: is empty"):
            read_mesh(tmp_path / "c.glb")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_an_obj_may_be_saved_as_utf_16(tmp_path, body, encoding):
    vertices, triangles = body[:2]
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in triangles + 1]
    (tmp_path / "a.obj").write_text("\n".join(lines), encoding=encoding)
    assert len(read_mesh(tmp_path / "a.obj").triangles) == len(triangles)


def test_a_skinned_file_is_read_as_it_was_written(tmp_path):
    vertices, triangles = capsule([0, 0, 0.2], [0, 0, 1.6], 0.2, 0.15)
    rng = np.random.default_rng(0)
    normals = rng.normal(size=vertices.shape)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    uv, morph = rng.random((len(vertices), 2)), Morph("smile", 0.01 * rng.normal(size=vertices.shape))
    look = Look(({"name": "skin", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}},), ({"source": 0},), (),
                (Picture("skin.png", png(), "image/png"),))  # fmt: skip
    surface = Surface("body", vertices, triangles, normals, {"TEXCOORD_0": uv}, 0, (morph,))
    mesh = StaticMesh(tmp_path / "x.obj", (surface, replace(surface, name="other", morphs=())), look)
    person_rig = rig_mesh(*person(40.0)[:2])
    skeleton, root = person_rig.skeleton(), person_rig.joints[0]
    joints = rng.integers(0, len(skeleton), (2 * len(vertices), 4))
    weights = rng.dirichlet(np.ones(4), 2 * len(vertices))
    write_skinned_glb(tmp_path / "x.glb", BoundMesh(mesh, skeleton, root, joints, weights))
    back = read_character(tmp_path / "x.glb")
    assert set(back.skeleton.names) == set(skeleton.names)
    at = {n: p for n, p in zip(back.skeleton.names, back.skeleton.rest_positions + back.root_at_rest, strict=True)}
    assert all(np.allclose(at[n], p, atol=1e-6) for n, p in zip(person_rig.names, person_rig.joints, strict=True))
    posed = pose_meshes(back, back.rest_motion())
    assert len(posed) == 2 and all(np.allclose(p[0], vertices, atol=1e-5) for p in posed)
    first = back.meshes[0]
    assert np.allclose(first.normals, normals, atol=1e-6) and np.allclose(first.uvs, uv, atol=1e-6)
    assert [m.name for m in first.morphs] == ["smile"] and np.allclose(
        first.morphs[0].offsets, morph.offsets, atol=1e-6
    )
    assert back.materials[0].image == png()
    assert np.abs(first.weights.sum(axis=1) - 1).max() < 1e-6


def test_a_vrm_names_its_bones(tmp_path):
    vertices, triangles, _ = person(40.0)
    rig = rig_mesh(vertices, triangles)
    mesh = StaticMesh(tmp_path / "x.obj", (Surface("body", vertices, triangles),))
    one = np.zeros((len(vertices), 1), np.int64)
    bones = {"hips": rig.roles["hips"], "leftUpperLeg": rig.roles["left_thigh"]}
    write_skinned_glb(tmp_path / "x.vrm", BoundMesh(mesh, rig.skeleton(), rig.joints[0], one, one + 1.0, bones))
    back = read_character(tmp_path / "x.vrm")
    assert back.skeleton.names[back.humanoid["leftUpperLeg"]] == "left_thigh"
    data = (tmp_path / "x.vrm").read_bytes()
    text = json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])
    assert text["extensions"]["VRMC_vrm"]["specVersion"] == "1.0" and text["extensionsUsed"] == ["VRMC_vrm"]


def fbx(path, vertices, triangles, skinned=False):
    """An FBX of one mesh in centimetres, Y up, under a node that turns and a model of half the size."""
    file = File()
    file.settings.number("UnitScaleFactor", 1.0)
    top = file.joint("top", 0, (0, 0, 0), "Null", LclRotation=(0, 90, 0))
    body = file.joint("body", top, (0, 0, 10), "Mesh", LclScaling=(0.5, 0.5, 0.5))
    corners = triangles.copy()
    corners[:, 2] = ~corners[:, 2]
    geometry = file.add("Geometry", "g\x00\x01Geometry", "Mesh", Vertices=(200 * vertices @ GLTF.T).ravel(),
                        PolygonVertexIndex=corners.astype(np.int32).ravel())  # fmt: skip
    file.links.add("C", "OO", geometry, body)
    if skinned:
        skin = file.add("Deformer", "s\x00\x01Deformer", "Skin")
        cluster = file.add("Deformer", "c\x00\x01SubDeformer", "Cluster")
        file.links.add("C", "OO", skin, geometry)
        file.links.add("C", "OO", cluster, skin)
    return file.write(path)


def test_an_fbx_without_a_skin(tmp_path, body):
    vertices, triangles, _ = body
    mesh = read_mesh(fbx(tmp_path / "a.fbx", vertices, triangles))
    # A quarter turn about the vertical, and 10 cm along the node's own third axis.
    turned = np.stack([-vertices[:, 1], vertices[:, 0], vertices[:, 2]], axis=1) + [0.1, 0, 0]
    found = mesh.vertices[mesh.triangles].mean(axis=1)
    assert np.allclose(np.sort(found, axis=0), np.sort(turned[triangles].mean(axis=1), axis=0), atol=1e-6)
    rig = rig_mesh(mesh.vertices, mesh.triangles)
    assert not rig.inside_out and any("turned to the front" in note for note in rig.notices)


def test_an_fbx_with_a_skin_is_sent_to_retarget(tmp_path, body):
    with pytest.raises(FormatError, match="has a skin already"):
        read_mesh(fbx(tmp_path / "a.fbx", *body[:2], skinned=True))


def test_meshes_without_extent_and_with_wrong_corners_are_refused(tmp_path, body):
    vertices, triangles, _ = body
    faces = "\n".join(f"f {a} {b} {c}" for a, b, c in triangles + 1)
    for text, said in (("v 1 2 3", "in one place"), ("v 1 2", "fewer than three"), ("v 1e200 0 0", "not finite")):
        (tmp_path / "a.obj").write_text(f"{text}\n" * len(vertices) + faces)
        with pytest.raises(FormatError, match=said):
            read_mesh(tmp_path / "a.obj")
    wrong = triangles.copy()
    wrong[3, 0] = -5
    rows = "\n".join(f"{x} {y} {z}" for x, y, z in vertices) + "\n" + "\n".join(f"3 {a} {b} {c}" for a, b, c in wrong)
    head = [f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}", *(f"property float {c}" for c in "xyz"),
            f"element face {len(wrong)}\nproperty list uchar int vertex_indices\nend_header"]  # fmt: skip
    (tmp_path / "a.ply").write_text("\n".join([*head, rows]) + "\n")
    with pytest.raises(FormatError, match="refers to vertex -5"):
        read_mesh(tmp_path / "a.ply")
    (tmp_path / "folder.obj").mkdir()
    with pytest.raises(FormatError, match="is a folder"):
        read_mesh(tmp_path / "folder.obj")


def test_an_obj_may_have_tabs_and_indents_and_names_with_spaces(tmp_path, body):
    vertices, triangles, _ = body
    lines = [f"  v\t{x} {y} {z}" for x, y, z in vertices] + [f"\tf\t{a} {b} {c}" for a, b, c in triangles + 1]
    (tmp_path / "a.obj").write_text("\n".join(["mtllib my look.mtl", "usemtl skin", *lines]))
    (tmp_path / "my look.mtl").write_text(
        "newmtl skin\nKd spectral a.rfl 1.0\nd x\nmap_Kd my skin.png\nnorm text.png\n"
    )
    (tmp_path / "my skin.png").write_bytes(png())
    (tmp_path / "text.png").write_text("no image")
    mesh = read_mesh(tmp_path / "a.obj")
    assert len(mesh.triangles) == len(triangles)
    assert [picture.name for picture in mesh.look.pictures] == ["my skin.png"]
    assert sum("was not understood" in note for note in mesh.notices) == 2
    assert any("text.png was not found or is no image" in note for note in mesh.notices)


def test_an_image_that_is_missing_leaves_nothing_behind(tmp_path, body):
    def lose(document):
        document["images"].insert(0, {"uri": "gone.png"})
        document["textures"] = [{"source": 0}, {"source": 1}]
        document["materials"][0]["normalTexture"] = {"index": 1}

    mesh = read_mesh(glb(tmp_path / "a.glb", *body[:2], edit=lose))
    assert any("gone.png" in note for note in mesh.notices)
    assert [picture.data for picture in mesh.look.pictures] == [png()]
    assert mesh.look.textures == ({}, {"source": 0})
    assert mesh.look.materials[0]["pbrMetallicRoughness"] == {}
    assert mesh.look.materials[0]["normalTexture"] == {"index": 1}


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
def test_empty_files_are_called_so(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    path.touch()
    with pytest.raises(FormatError, match=f"{path}: is empty"):
        read_mesh(path)


def test_a_vertex_that_was_moved_far_off_is_named(tmp_path):
    vertices, triangles = person()[:2]
    vertices[7] = [1e6, 0.0, 0.0]
    lines = [*(f"v {x} {y} {z}" for x, y, z in vertices), *(f"f {a} {b} {c}" for a, b, c in triangles + 1)]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    with pytest.raises(FormatError, match="vertex 7 of the mesh 'a' is .* times as far off"):
        read_mesh(tmp_path / "a.obj")
