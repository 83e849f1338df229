"""A mesh without a skeleton made into a character: read, rigged, weighted, and moved by takes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from muybridge.errors import MuybridgeError
from muybridge.geometry.roles import RoleMap
from muybridge.geometry.skeleton.profiles import PROFILES
from muybridge.infer.networks.characters import RiggerNetwork, SkinningNetwork
from muybridge.infer.pipelines.characters.retarget import Placed, Target, write_placed
from muybridge.models.shipped import shipped_model
from muybridge.motion.character.meshes.bound_mesh import BoundMesh, NamedMotion
from muybridge.motion.character.meshes.static_mesh import StaticMesh
from muybridge.motion.character.meshes.write_fbx import write_skinned_fbx
from muybridge.motion.character.meshes.write_gltf import write_skinned_glb
from muybridge.motion.character.meshes.write_usd import USD_SUFFIXES, require_usd, write_skinned_usd
from muybridge.motion.character.read import read_character
from muybridge.motion.character.rigging.joints_file import KnownJoints, apply_joints, read_joints
from muybridge.motion.character.rigging.rig import MeshRig, RigOptions, rig_mesh, rig_of_joints
from muybridge.motion.character.rigging.templates import TEMPLATES
from muybridge.motion.character.weights import WeightOptions, packed_weights, skin_weights

INFLUENCES = 4
_LEAST_HEIGHT, _MOST_HEIGHT = 0.25, 4.0  # metres between which a file without a unit is taken to be in metres


@dataclass(frozen=True, eq=False)
class Rigged:
    """A mesh and the skeleton in it.

    Attributes:
        mesh: upright, facing -Y, metres.
        rig: its skeleton.
        notices: what was assumed, one sentence each.
    """

    mesh: StaticMesh
    rig: MeshRig
    notices: tuple[str, ...]


def rig_static(
    mesh: StaticMesh, options: RigOptions, joints: Path | None = None, height: float | None = None
) -> Rigged:
    """Put a skeleton into a mesh.

    Args:
        mesh: as its file has it.
        options: of rigging.
        joints: file of places that are known.
        height: metres that the body is tall; None: as the file has it.

    Raises:
        FormatError: the file of joints cannot be read.
        ModelError: the shipped network is missing.
        MuybridgeError: the mesh shows no body of the template.
    """
    path = mesh.path
    known = KnownJoints(None, {})
    if joints is not None:
        known = read_joints(joints)
        options = replace(options, template=known.template or options.template)
    mesh, notices = _in_metres(mesh)
    if joints is not None:
        notices = (*notices, *known.notices(joints, path))
    whole = set(TEMPLATES[options.template].roles) <= set(known.places)
    if known.new_from_old is not None and whole:
        rig = rig_of_joints(mesh.vertices, mesh.triangles, known.places, known.new_from_old, options)
    else:
        network = RiggerNetwork(shipped_model("rigger"))
        try:
            rig = rig_mesh(mesh.vertices, mesh.triangles, options, network)
        except MuybridgeError as error:
            if not whole:
                raise error.about(str(path)) from None
            # Every joint is named, by hand where none could be found: the mesh stays as it stands.
            rig = rig_of_joints(mesh.vertices, mesh.triangles, known.places, np.eye(4), options)
    matrix = rig.new_from_old
    if height is not None and not known.places:
        size = np.diag([height / float(mesh.moved(matrix).extent[2])] * 3 + [1.0])
        matrix = size @ matrix
        rig = replace(rig, places={r: size[:3, :3] @ p for r, p in rig.places.items()}, new_from_old=matrix)
    mesh = mesh.moved(matrix, rig.inside_out)
    if joints is not None:
        rig = apply_joints(rig, known.places, mesh.vertices, joints)
    return Rigged(mesh, rig, (*mesh.notices, *notices, *(f"{path.name}: {note}" for note in rig.notices)))


def _in_metres(mesh: StaticMesh) -> tuple[StaticMesh, tuple[str, ...]]:
    """A mesh whose format states no unit, in metres by its size."""
    tall = float(mesh.extent.max())
    if mesh.faces_front or _LEAST_HEIGHT <= tall <= _MOST_HEIGHT:
        return mesh, ()
    units = {"centimetres": 0.01, "millimetres": 0.001, "inches": 0.0254}
    for name, metres in units.items():
        if 0.8 <= tall * metres <= 2.6:
            return mesh.moved(np.diag([metres] * 3 + [1.0])), (
                f"{mesh.path.name}: is {tall:.4g} units large and was read as {name}",)  # fmt: skip
    scale = 1.7 / tall
    return mesh.moved(np.diag([scale] * 3 + [1.0])), (
        f"{mesh.path.name}: is {tall:.4g} units large, of no known unit, and was made 1.7 m",)  # fmt: skip


def bind_mesh(rigged: Rigged, humanoid: bool = False) -> BoundMesh:
    """A mesh weighted to its skeleton, by heat as the shipped network corrects it.

    Args:
        rigged: mesh and skeleton.
        humanoid: whether the joints are named as VRM's bones, too.

    Raises:
        ModelError: the shipped network is missing.
    """
    rig, mesh = rigged.rig, rigged.mesh
    parents = np.asarray(rig.parents, np.int64)
    network = SkinningNetwork(shipped_model("skinning"))
    options = WeightOptions(influences=INFLUENCES)
    joints, weights = packed_weights(
        skin_weights(mesh.vertices, mesh.triangles, rig.joints, parents, options=options, network=network), INFLUENCES
    )
    if len(rig.held):
        carried = rig.held >= 0
        joints[carried], weights[carried] = rig.held[carried, None], np.eye(joints.shape[1])[0]
    bones = {PROFILES["vrm"][role]: j for role, j in rig.roles.items() if role in PROFILES["vrm"]}
    return BoundMesh(mesh, rig.skeleton(), rig.joints[0], joints, weights, bones if humanoid else None)


def bound_target(bound: BoundMesh, rig: MeshRig, path: Path) -> Target:
    """A bound mesh as a character that takes are put onto, whose file at rest is written for that.

    Args:
        bound: the mesh.
        rig: whose skeleton it is bound to.
        path: of the file, `.glb` or `.vrm`.
    """
    write_skinned_glb(path, bound)
    character = read_character(path)
    roles = {role: character.skeleton.index(name) for role, name in zip(rig.template.roles, rig.names, strict=True)}
    return Target(character, RoleMap(roles, "template", "human"))


def write_bound(bound: BoundMesh, out: Path, target: Target | None = None, placed: Sequence[Placed] = ()) -> list[str]:
    """Write a bound mesh at rest, or with takes; what was left out is returned, one sentence each.

    Args:
        bound: the mesh.
        out: file to write, of a format of `OUTPUTS`.
        target: the character of `bound_target`, which the takes were put onto.
        placed: takes, each a clip of the file.

    Raises:
        OutputError: the file cannot be written.
    """
    if target is None:
        return list(OUTPUTS[out.suffix.lower()](out, bound, ()))
    if out.suffix.lower() == target.character.path.suffix.lower():
        return write_placed(placed, target, [out])
    same = bound.on(target.character.skeleton, target.character.root_at_rest)
    clips = [NamedMotion(one.name, one.result.motion) for one in placed]
    return list(OUTPUTS[out.suffix.lower()](out, same, clips))


def _write_gltf(path: Path, bound: BoundMesh, _: Sequence[NamedMotion]) -> tuple[str, ...]:
    write_skinned_glb(path, bound)  # takes are added to the file that they were put onto
    return ()


Writer = Callable[[Path, BoundMesh, Sequence[NamedMotion]], tuple[str, ...]]
OUTPUTS: dict[str, Writer] = {
    ".glb": _write_gltf,
    ".vrm": _write_gltf,
    ".fbx": write_skinned_fbx,
    **dict.fromkeys(USD_SUFFIXES, write_skinned_usd),
}


def check_character_output(out: Path) -> None:
    """MuybridgeError where a file is of a format that holds no skinned mesh of ours, or that needs an extra."""
    if out.is_dir():
        raise MuybridgeError(f"{out}: is a folder", remedy="other_name")
    if out.suffix.lower() not in OUTPUTS:
        *first, last = OUTPUTS
        raise MuybridgeError(f"{out}: a character is written as {', '.join(first)} or {last}", remedy="other_name")
    if out.suffix.lower() in USD_SUFFIXES:
        require_usd(out)
