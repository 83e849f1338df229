"""USD files of a mesh with a new skeleton: OpenUSD's own skinning puts the vertices where the weights have them."""

import io
import sys
import zipfile
from dataclasses import replace

import numpy as np
import pytest

from muybridge.errors import MuybridgeError
from muybridge.motion.character.meshes import BoundMesh
from muybridge.motion.character.meshes.write_usd import texture_folder, write_skinned_usd
from tests.motion.character.meshes.bound_figures import dance, figure, picture, posed

WORLD_FROM_USD = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


@pytest.fixture(scope="module")
def bound() -> BoundMesh:
    return figure()


def usd():
    return pytest.importorskip("pxr", reason="OpenUSD (the extra usd) is not installed")


def stage_of(path, clip=None):
    usd()
    from pxr import Usd

    stage = Usd.Stage.Open(str(path))
    if clip is not None:
        assert stage.GetDefaultPrim().GetVariantSet("clip").SetVariantSelection(clip)
    return stage


def skinned(stage, frames, step=1.0):
    """(T, V, 3) metres in the world, by UsdSkel."""
    from pxr import Usd, UsdGeom, UsdSkel

    cache, root = UsdSkel.Cache(), UsdSkel.Root(stage.GetDefaultPrim())
    assert cache.Populate(root, Usd.PrimDefaultPredicate)
    (binding,) = cache.ComputeSkelBindings(root, Usd.PrimDefaultPredicate)
    query, out = cache.GetSkelQuery(binding.GetSkeleton()), []
    for t in range(frames):
        own = []
        for target in binding.GetSkinningTargets():
            points = UsdGeom.Mesh(target.GetPrim()).GetPointsAttr().Get()
            assert target.ComputeSkinnedPoints(query.ComputeSkinningTransforms(t * step), points, t * step)
            own.append(np.array(points))
        out.append(np.concatenate(own) @ WORLD_FROM_USD.T)
    return np.array(out)


def named(bound):
    """The vertices of all surfaces in the order of the stage: objects by name."""
    return np.concatenate([np.arange(at.start, at.stop) for _, parts in bound.objects() for _, at in parts])


@pytest.mark.parametrize("suffix", [".usdc", ".usda", ".usdz"])
def test_openusd_poses_the_vertices_alike(tmp_path, bound, suffix):
    usd()
    clip, path = dance(bound), tmp_path / f"x{suffix}"
    write_skinned_usd(path, bound, [clip])
    stage = stage_of(path)
    assert np.abs(skinned(stage, len(clip.motion)) - posed(bound, clip.motion)[:, named(bound)]).max() < 1e-5
    assert stage.GetTimeCodesPerSecond() == 30.0 and stage.GetEndTimeCode() == len(clip.motion) - 1
    assert stage.GetMetadata("metersPerUnit") == 1.0 and stage.GetMetadata("upAxis") == "Y"


def test_takes_are_variants_at_the_rate_of_the_first(tmp_path, bound):
    usd()
    clips = [dance(bound), dance(bound, "a bow", 5, 24.0, seed=1)]
    write_skinned_usd(tmp_path / "x.usdc", bound, clips)
    assert skinned(stage_of(tmp_path / "x.usdc"), 1).shape[0] == 1  # the first is chosen
    for clip, name in zip(clips, ("dance", "a_bow"), strict=True):
        seen = skinned(stage_of(tmp_path / "x.usdc", name), len(clip.motion), 30.0 / clip.motion.fps)
        assert np.abs(seen - posed(bound, clip.motion)[:, named(bound)]).max() < 1e-5


def test_a_file_without_a_take_stands_at_rest(tmp_path, bound):
    usd()
    write_skinned_usd(tmp_path / "x.usdc", bound)
    assert np.abs(skinned(stage_of(tmp_path / "x.usdc"), 1)[0] - bound.mesh.vertices[named(bound)]).max() < 1e-5


def test_materials_and_pictures_are_found(tmp_path, bound):
    usd()
    from pxr import UsdGeom, UsdShade

    write_skinned_usd(tmp_path / "x.usda", bound, [dance(bound)])
    stage = stage_of(tmp_path / "x.usda")
    texture = UsdShade.Shader(stage.GetPrimAtPath("/character/materials/skin/base"))
    file = texture.GetInput("file").Get()
    with open(file.resolvedPath, "rb") as found:
        assert found.read() == picture()
    assert file.path == "x_textures/skin.png" and texture.GetInput("wrapS").Get() == "clamp"
    surface = UsdShade.Shader(stage.GetPrimAtPath("/character/materials/cloth/surface"))
    values = {name: surface.GetInput(name).Get() for name in ("opacity", "metallic", "roughness")}
    assert values == pytest.approx({"opacity": 0.5, "metallic": 0.25, "roughness": 0.6})
    assert np.allclose(surface.GetInput("diffuseColor").Get(), [0.1, 0.5, 0.2])
    body = UsdGeom.Mesh(stage.GetPrimAtPath("/character/body"))
    subsets = UsdShade.MaterialBindingAPI(body.GetPrim()).GetMaterialBindSubsets()
    faces = [len(s.triangles) for s in bound.mesh.surfaces[:2]]
    assert [len(s.GetIndicesAttr().Get()) for s in subsets] == faces
    looks = [UsdShade.MaterialBindingAPI(s.GetPrim()).ComputeBoundMaterial()[0].GetPath().name for s in subsets]
    assert looks == ["skin", "cloth"]
    st = np.array(UsdGeom.PrimvarsAPI(body).GetPrimvar("st").Get())
    assert np.allclose(st[: len(st) // 2], bound.mesh.surfaces[0].attributes["TEXCOORD_0"] * [1, -1] + [0, 1])


def test_shapes_are_kept(tmp_path, bound):
    usd()
    from pxr import UsdSkel

    write_skinned_usd(tmp_path / "x.usdc", bound)
    stage = stage_of(tmp_path / "x.usdc")
    binding = UsdSkel.BindingAPI(stage.GetPrimAtPath("/character/body"))
    assert list(binding.GetBlendShapesAttr().Get()) == ["smile"]
    query = UsdSkel.BlendShapeQuery(binding)
    points = np.array(stage.GetPrimAtPath("/character/body").GetAttribute("points").Get())
    offsets = np.array(query.GetBlendShape(0).GetOffsetsAttr().Get())
    at = np.array(query.GetBlendShape(0).GetPointIndicesAttr().Get())
    assert (points[at, 1] > 1.5).all() and np.allclose(offsets @ WORLD_FROM_USD.T, [0.0, -0.01, 0.0])


def test_a_package_holds_its_pictures(tmp_path, bound):
    usd()
    write_skinned_usd(tmp_path / "x.usdz", bound, [dance(bound)])
    with zipfile.ZipFile(io.BytesIO((tmp_path / "x.usdz").read_bytes())) as archive:
        assert archive.namelist() == ["x.usdc", "textures/bumps.jpg", "textures/skin.png"]
        assert archive.read("textures/skin.png") == picture()
    stage = stage_of(tmp_path / "x.usdz")
    texture = stage.GetPrimAtPath("/character/materials/skin/base")
    assert texture.GetAttribute("inputs:file").Get().resolvedPath == f"{tmp_path}/x.usdz[textures/skin.png]"
    assert sorted(f.name for f in tmp_path.iterdir()) == ["x.usdz"]


def test_textures_go_beside_what_cannot_hold_them(tmp_path, bound):
    assert texture_folder(tmp_path / "x.usdc", bound.mesh) == tmp_path / "x_textures"
    assert texture_folder(tmp_path / "x.usdz", bound.mesh) is None
    plain = replace(bound.mesh, look=replace(bound.mesh.look, pictures=()))
    assert texture_folder(tmp_path / "x.usda", plain) is None


def test_the_extra_is_named_where_it_is_missing(tmp_path, bound, monkeypatch):
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(MuybridgeError, match="needs OpenUSD") as raised:
        write_skinned_usd(tmp_path / "x.usdc", bound)
    assert raised.value.remedy == "usd_extra" and not list(tmp_path.iterdir())
