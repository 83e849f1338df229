"""A mesh with a new skeleton, its weights and its takes as USD: UsdSkel, with preview surfaces as materials.

Metres, Y up, facing +Z at rest, as in our glTF. A time code is a frame of the first take. Of several takes, the variant
set `clip` of the character chooses the one that is shown.

Source: Pixar, UsdSkel: Schemas In-Depth, OpenUSD documentation.
"""

import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from muybridge import __version__
from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.files import replacing
from muybridge.geometry.numerics.rotations import continuous_quat, quat_from_matrix
from muybridge.geometry.skeleton.local_frames import motion_frames, own_axes, rest_frames
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.character.meshes.bound_mesh import BoundMesh, NamedMotion
from muybridge.motion.character.meshes.static_mesh import StaticMesh, Surface
from muybridge.motion.character.meshes.usd_materials import add_materials, coordinates, picture_files
from muybridge.motion.formats.skeletal.bvh import BVH_FROM_WORLD
from muybridge.motion.formats.skeletal.usd import joint_paths

USD_SUFFIXES = (".usdc", ".usda", ".usdz")
_TOP, _SKELETON = "/character", "/character/skeleton"
_DEFAULT_FPS = 30.0


def require_usd(path: Path) -> None:
    """MuybridgeError where OpenUSD is not installed, which writing `path` needs."""
    try:
        import pxr  # noqa: F401
    except ImportError:
        raise MuybridgeError(f"{path}: writing {path.suffix.lower()} files needs OpenUSD", remedy="usd_extra") from None


def texture_folder(path: Path, mesh: StaticMesh) -> Path | None:
    """The folder beside a file that its textures go to; None where it has none, or holds them itself."""
    beside = mesh.look.pictures and path.suffix.lower() != ".usdz"
    return path.with_name(f"{path.stem}_textures") if beside else None


def write_skinned_usd(path: Path, bound: BoundMesh, clips: Sequence[NamedMotion] = ()) -> tuple[str, ...]:
    """Write a mesh with its skeleton, and an animation for each take.

    Args:
        path: `.usdc`, `.usda` or `.usdz`; replaced only once it is complete. Textures are in the `.usdz`, else in the
            folder that `texture_folder` names.
        bound: the mesh and its skeleton.
        clips: takes. Without any, the file shows the pose at rest.

    Returns:
        Nothing was left out: no notices.

    Raises:
        MuybridgeError: OpenUSD is not installed.
        OutputError: the file cannot be written.
    """
    require_usd(path)
    textures = texture_folder(path, bound.mesh)
    with tempfile.TemporaryDirectory() as work:
        packed = path.suffix.lower() == ".usdz"
        made = Path(work) / (f"{path.stem}.usdc" if packed else path.name)
        folder = "textures" if textures is None else textures.name
        _build(made, bound, clips, folder)
        for name, picture in zip(picture_files(bound.mesh.look.pictures), bound.mesh.look.pictures, strict=True):
            target = (made.parent if textures is None else path.parent) / folder / name
            with replacing(target) as temporary:
                temporary.write_bytes(picture.data)
        with replacing(path) as temporary:
            if packed:
                _pack(temporary, made)
            else:
                shutil.copyfile(made, temporary)
    return ()


def _pack(path: Path, stage: Path) -> None:
    """A package of a stage and of all other files in its folder."""
    from pxr import Sdf, Usd

    kind = getattr(Sdf, "ZipFileWriter", None) or Usd.ZipFileWriter  # it moved in 2024
    with kind.CreateNew(str(path)) as package:
        package.AddFile(str(stage), stage.name)  # what is shown comes first
        for file in sorted(f for f in stage.parent.rglob("*") if f.is_file() and f != stage):
            package.AddFile(str(file), file.relative_to(stage.parent).as_posix())


def _build(path: Path, bound: BoundMesh, clips: Sequence[NamedMotion], folder: str) -> None:
    """The stage as a file."""
    from pxr import Usd, UsdGeom, UsdSkel

    stage = Usd.Stage.CreateNew(str(path))
    stage.SetMetadata("comment", f"written by muybridge {__version__}")
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    fps = clips[0].motion.fps if clips else _DEFAULT_FPS
    stage.SetFramesPerSecond(fps)
    stage.SetTimeCodesPerSecond(fps)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(max(((len(c.motion) - 1) * fps / c.motion.fps for c in clips), default=0))
    root = UsdSkel.Root.Define(stage, _TOP)
    stage.SetDefaultPrim(root.GetPrim())
    _add_skeleton(stage, bound)
    materials = add_materials(stage, f"{_TOP}/materials", bound.mesh.look, folder)
    for name, parts in bound.objects():
        _add_mesh(stage, bound, name, parts, materials)
    _add_clips(stage, bound, clips, fps)
    stage.GetRootLayer().Save()


def _add_skeleton(stage: Any, bound: BoundMesh) -> None:
    from pxr import UsdSkel

    skeleton = bound.skeleton
    turns, places = rest_frames(skeleton, BVH_FROM_WORLD.T)
    places = places.copy()
    for j in skeleton.roots:
        places[j] = places[j] + BVH_FROM_WORLD @ bound.root
    world_turns = BVH_FROM_WORLD @ own_axes(skeleton, BVH_FROM_WORLD.T)
    world_places = (skeleton.rest_positions + bound.root) @ BVH_FROM_WORLD.T
    out = UsdSkel.Skeleton.Define(stage, _SKELETON)
    out.CreateJointsAttr(joint_paths(skeleton))
    out.CreateJointNamesAttr(list(skeleton.names))
    out.CreateBindTransformsAttr(_matrices(world_turns, world_places))
    out.CreateRestTransformsAttr(_matrices(turns, places))
    UsdSkel.BindingAPI.Apply(out.GetPrim())


def _matrices(turns: FloatArray, places: FloatArray) -> Any:
    """(J, 3, 3) rotations and (J, 3) translations as USD's matrices, whose vectors are rows."""
    from pxr import Vt

    out = np.tile(np.eye(4), (len(turns), 1, 1))
    out[:, :3, :3], out[:, 3, :3] = np.swapaxes(turns, 1, 2), places
    return Vt.Matrix4dArray.FromNumpy(np.ascontiguousarray(out))


def _floats(values: FloatArray, kind: str = "Vec3fArray") -> Any:
    from pxr import Vt

    return getattr(Vt, kind).FromNumpy(np.ascontiguousarray(values, np.float32))


def _add_mesh(
    stage: Any, bound: BoundMesh, name: str, parts: list[tuple[Surface, slice]], materials: list[Any]
) -> None:
    """An object of the scene with its skin, its materials and its shapes."""
    from pxr import Gf, Tf, UsdGeom, UsdSkel, Vt

    path = f"{_TOP}/{Tf.MakeValidIdentifier(name)}"
    while stage.GetPrimAtPath(path):
        path += "_"
    surfaces = [surface for surface, _ in parts]
    starts = np.cumsum([0, *(len(s.positions) for s in surfaces[:-1])])
    triangles = np.concatenate([s.triangles + a for s, a in zip(surfaces, starts, strict=True)])
    points = np.concatenate([s.positions for s in surfaces]) @ BVH_FROM_WORLD.T
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.GetPrim().SetMetadata("displayName", name)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(triangles), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(triangles.astype(np.int32).ravel()))
    mesh.CreatePointsAttr(_floats(points))
    mesh.CreateExtentAttr(_floats(np.stack([points.min(axis=0), points.max(axis=0)])))
    _add_vertex_values(mesh, surfaces)
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([_SKELETON])
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d(1.0))
    joints = np.concatenate([bound.joints[at] for _, at in parts])
    weights = np.concatenate([bound.weights[at] for _, at in parts])
    width = joints.shape[1]
    binding.CreateJointIndicesPrimvar(False, width).Set(Vt.IntArray.FromNumpy(joints.astype(np.int32).ravel()))
    binding.CreateJointWeightsPrimvar(False, width).Set(_floats(weights.ravel(), "FloatArray"))
    _add_looks(stage, mesh, surfaces, materials, bound)
    _add_shapes(stage, path, binding, surfaces)


def _add_vertex_values(mesh: Any, surfaces: list[Surface]) -> None:
    """Normals, texture coordinates and colours; of surfaces without, coordinates are zero and colours white."""
    from pxr import Sdf, UsdGeom

    vertex = UsdGeom.Tokens.vertex
    if all(s.normals is not None for s in surfaces):
        normals = np.concatenate([s.normals for s in surfaces if s.normals is not None])
        mesh.CreateNormalsAttr(_floats(normals @ BVH_FROM_WORLD.T))
        mesh.SetNormalsInterpolation(vertex)
    values = UsdGeom.PrimvarsAPI(mesh)
    for key in sorted({k for s in surfaces for k in s.attributes if k.startswith("TEXCOORD_")}):
        uv = _of_all(surfaces, key, np.zeros(2)) * [1, -1] + [0, 1]
        name = coordinates(int(key.rpartition("_")[2]))
        values.CreatePrimvar(name, Sdf.ValueTypeNames.TexCoord2fArray, vertex).Set(_floats(uv, "Vec2fArray"))
    if any("COLOR_0" in s.attributes for s in surfaces):
        colours = _of_all(surfaces, "COLOR_0", np.ones(4))
        mesh.CreateDisplayColorPrimvar(vertex).Set(_floats(colours[:, :3]))
        if (colours[:, 3] < 1).any():
            mesh.CreateDisplayOpacityPrimvar(vertex).Set(_floats(colours[:, 3], "FloatArray"))


def _of_all(surfaces: list[Surface], key: str, usual: FloatArray) -> FloatArray:
    """(V, K) the values of an attribute on all surfaces."""
    out = []
    for surface in surfaces:
        values = np.tile(usual, (len(surface.positions), 1))
        given = surface.attributes.get(key, values)
        values[:, : given.shape[1]] = given
        out.append(values)
    return np.concatenate(out)


def _add_looks(stage: Any, mesh: Any, surfaces: list[Surface], materials: list[Any], bound: BoundMesh) -> None:
    """The material of a mesh, or of sets of its triangles."""
    from pxr import UsdGeom, UsdShade, Vt

    numbers = [s.material for s in surfaces]
    used = [n for n in dict.fromkeys(numbers) if n is not None]
    looks = bound.mesh.look.materials
    mesh.CreateDoubleSidedAttr(any(bool(looks[n].get("doubleSided")) for n in used) if used else True)
    if len(set(numbers)) == 1:
        if used:
            UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(materials[used[0]])
        return
    of_face = np.repeat([-1 if n is None else n for n in numbers], [len(s.triangles) for s in surfaces])
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).SetMaterialBindSubsetsFamilyType(UsdGeom.Tokens.nonOverlapping)
    for n in used:
        own = Vt.IntArray.FromNumpy(np.flatnonzero(of_face == n).astype(np.int32))
        subset = UsdShade.MaterialBindingAPI(mesh.GetPrim()).CreateMaterialBindSubset(f"faces_{n}", own)
        UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(materials[n])


def _add_shapes(stage: Any, path: str, binding: Any, surfaces: list[Surface]) -> None:
    """The shapes that a mesh can be blended towards; a surface without a shape stays in it as it is."""
    from pxr import Tf, UsdSkel, Vt

    own = [{morph.name: morph.offsets for morph in s.morphs} for s in surfaces]
    names = list(dict.fromkeys(name for shapes in own for name in shapes))
    targets = []
    for k, name in enumerate(names):
        parts = [shapes.get(name, np.zeros_like(s.positions)) for shapes, s in zip(own, surfaces, strict=True)]
        offsets = np.concatenate(parts)
        moved = np.flatnonzero((offsets != 0).any(axis=1))
        shape = UsdSkel.BlendShape.Define(stage, f"{path}/shape_{k}_{Tf.MakeValidIdentifier(name)}")
        shape.CreateOffsetsAttr(_floats(offsets[moved] @ BVH_FROM_WORLD.T))
        shape.CreatePointIndicesAttr(Vt.IntArray.FromNumpy(moved.astype(np.int32)))
        targets.append(shape.GetPath())
    if targets:
        binding.CreateBlendShapesAttr(names)
        binding.CreateBlendShapeTargetsRel().SetTargets(targets)


def _add_clips(stage: Any, bound: BoundMesh, clips: Sequence[NamedMotion], fps: float) -> None:
    """An animation for each take, and which one moves the skeleton."""
    from pxr import Tf, UsdSkel

    paths: dict[str, str] = {}
    for clip in clips:
        word = Tf.MakeValidIdentifier(clip.name)
        while word in paths:
            word += "_"
        paths[word] = f"{_TOP}/animations/{word}"
        _add_animation(stage, paths[word], bound, clip.motion, fps)
        stage.GetPrimAtPath(paths[word]).SetMetadata("displayName", clip.name)
    skeleton = UsdSkel.BindingAPI(stage.GetPrimAtPath(_SKELETON))
    if len(paths) == 1:
        skeleton.CreateAnimationSourceRel().SetTargets(list(paths.values()))
    elif paths:
        choices = stage.GetPrimAtPath(_TOP).GetVariantSets().AddVariantSet("clip")
        for word, path in paths.items():
            choices.AddVariant(word)
            choices.SetVariantSelection(word)
            with choices.GetVariantEditContext():
                skeleton.CreateAnimationSourceRel().SetTargets([path])
        choices.SetVariantSelection(next(iter(paths)))


def _add_animation(stage: Any, path: str, bound: BoundMesh, motion: Motion, fps: float) -> None:
    from pxr import Gf, UsdSkel, Vt

    turns, places = motion_frames(motion, BVH_FROM_WORLD.T)
    quat = continuous_quat(quat_from_matrix(turns)).astype(np.float32)
    out = UsdSkel.Animation.Define(stage, path)
    out.CreateJointsAttr(joint_paths(motion.skeleton))
    out.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1, 1, 1)] * len(motion.skeleton)))
    rotations, translations = out.CreateRotationsAttr(), out.CreateTranslationsAttr()
    for t in range(len(motion)):
        code = t * fps / motion.fps
        rotations.Set(Vt.QuatfArray([Gf.Quatf(*q) for q in quat[t].tolist()]), code)
        translations.Set(_floats(places[t]), code)
