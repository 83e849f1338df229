"""FBX files of a mesh with a new skeleton: what readers find in them is what was bound."""

import os
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from muybridge.motion.character import read_character
from muybridge.motion.character.meshes import BoundMesh, write_skinned_fbx
from muybridge.motion.formats.fbx.container import read_fbx_nodes
from muybridge.motion.formats.registry import ReadOptions, read_file
from tests.motion.character.meshes.bound_figures import SEAM, apart, dance, figure, picture, posed, read_posed

BLENDER = os.environ.get("MUYBRIDGE_BLENDER_PYTHON") or (sys.executable if find_spec("bpy") else None)


@pytest.fixture(scope="module")
def bound() -> BoundMesh:
    return figure()


def test_vertices_follow_the_take_as_the_weights_have_it(tmp_path, bound):
    clips = [dance(bound), dance(bound, "bow", 5, 24.0, seed=1)]
    notices = write_skinned_fbx(tmp_path / "x.fbx", bound, clips)
    for clip in clips:
        back, seen = read_posed(tmp_path / "x.fbx", clip.name)
        assert back.clips == ("dance", "bow") and len(back.motion) == len(clip.motion)
        assert apart(seen, posed(bound, clip.motion)) < 1e-5
        assert back.motion.fps == pytest.approx(clip.motion.fps)
    assert set(back.skeleton.names) == set(bound.skeleton.names)
    (notice,) = notices
    assert notice.startswith("x.fbx: FBX has no place") and "as metallicRoughnessTexture;" in notice


def test_a_file_without_a_take_stands_at_rest(tmp_path, bound):
    write_skinned_fbx(tmp_path / "x.fbx", bound)
    back, seen = read_posed(tmp_path / "x.fbx")
    assert not back.clips
    used = np.unique(bound.mesh.triangles)
    assert apart(seen[:1], bound.mesh.vertices[None, used]) < 1e-6
    at = dict(zip(back.skeleton.names, back.skeleton.rest_positions + back.root_at_rest, strict=True))
    wanted = bound.skeleton.rest_positions + bound.root
    assert all(np.allclose(at[n], p, atol=1e-6) for n, p in zip(bound.skeleton.names, wanted, strict=True))


def test_corners_keep_normals_and_texture_coordinates_and_points_are_joined(tmp_path, bound):
    write_skinned_fbx(tmp_path / "x.fbx", bound)
    back = read_character(tmp_path / "x.fbx")
    assert [m.name for m in back.meshes] == ["body", "body", "cloth"]
    for mesh, surface in zip(back.meshes[:2], bound.mesh.surfaces[:2], strict=True):
        assert len(mesh.triangles) == len(surface.triangles)
        corners = mesh.triangles.ravel(), surface.triangles.ravel()
        assert np.allclose(mesh.positions[corners[0]], surface.positions[corners[1]], atol=1e-6)
        assert np.allclose(mesh.normals[corners[0]], surface.normals[corners[1]], atol=1e-6)
        assert np.allclose(mesh.uvs[corners[0]], surface.attributes["TEXCOORD_0"][corners[1]], atol=1e-6)
        offsets = mesh.morphs[0].offsets[corners[0]]
        assert np.allclose(offsets, surface.morphs[0].offsets[corners[1]], atol=1e-6)
    assert back.meshes[0].morphs[0].name == "smile" and not back.meshes[2].morphs
    body = next(n for n in read_fbx_nodes(tmp_path / "x.fbx").all("Objects")[0].all("Geometry"))
    points = body.all("Vertices")[0].properties[0].size // 3
    assert points == len(bound.mesh.surfaces[0].positions) - SEAM
    colours = body.all("LayerElementColor")[0].all("Colors")[0].properties[0].reshape(-1, 4)
    first = bound.mesh.surfaces[0]
    wanted = first.attributes["COLOR_0"][first.triangles.ravel()]
    assert np.allclose(colours[: len(wanted)], wanted)


def test_materials_have_their_colours_and_pictures(tmp_path, bound):
    write_skinned_fbx(tmp_path / "x.fbx", bound)
    back = read_character(tmp_path / "x.fbx")
    skin, cloth, none = (back.materials[m.material] for m in back.meshes)
    assert (skin.name, skin.image, skin.image_type) == ("skin", picture(), "image/png")
    assert cloth.image is None and np.allclose(cloth.colour, [0.1, 0.5, 0.2, 0.5])
    assert np.allclose(none.colour, 1.0)
    objects = read_fbx_nodes(tmp_path / "x.fbx").all("Objects")[0]
    files = [node.all("RelativeFilename")[0].properties[0] for node in objects.all("Video")]
    assert files == ["x.fbm/skin.png", "x.fbm/bumps.jpg"]
    values = {p.properties[0]: p.properties[4:] for p in objects.all("Material")[1].all("Properties70")[0].all("P")}
    assert values["Shininess"] == pytest.approx((16.0,)) and values["ReflectionFactor"] == (0.25,)
    assert values["Opacity"] == (0.5,)


def test_pictures_of_one_name_stay_two(tmp_path, bound):
    look = bound.mesh.look
    same = replace(look, pictures=(look.pictures[0], replace(look.pictures[0], data=picture(colour=(1, 2, 3)))))
    write_skinned_fbx(tmp_path / "x.fbx", replace(bound, mesh=replace(bound.mesh, look=same)))
    objects = read_fbx_nodes(tmp_path / "x.fbx").all("Objects")[0]
    files = [node.all("RelativeFilename")[0].properties[0] for node in objects.all("Video")]
    assert len(set(files)) == 2 and all(file.endswith(".png") for file in files)


def test_the_file_is_a_take_for_other_commands(tmp_path, bound):
    clip = dance(bound)
    write_skinned_fbx(tmp_path / "x.fbx", bound, [clip])
    motion = read_file(tmp_path / "x.fbx", ReadOptions(clip="dance")).motion
    order = [motion.skeleton.index(name) for name in bound.skeleton.names]
    assert np.allclose(motion.joint_positions_world()[:, order], clip.motion.joint_positions_world(), atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("reader", ["python", "c"])
def test_blender_poses_the_vertices_alike(tmp_path, bound, reader):
    if not BLENDER:
        pytest.skip("Blender's Python module is not here: pip install bpy, or set MUYBRIDGE_BLENDER_PYTHON")
    clip = dance(bound)
    write_skinned_fbx(tmp_path / "x.fbx", bound, [clip])
    script = Path(__file__).with_name("blender_vertices.py")
    done = subprocess.run([BLENDER, script, tmp_path / "x.fbx", tmp_path / "seen.npz", str(len(clip.motion)), reader],
                          capture_output=True, text=True, timeout=300)  # fmt: skip
    assert done.returncode == 0, done.stderr
    seen = dict(np.load(tmp_path / "seen.npz"))
    assert apart(seen["vertices"], posed(bound, clip.motion)) < 1e-4
    assert seen["pictures"].tolist() == ["bumps", "skin"] and seen["uv_layers"].tolist() == [1, 0]
