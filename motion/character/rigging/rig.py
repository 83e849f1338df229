"""A skeleton for a mesh: repair, orientation, volume, landmarks, joints.

After Baran and Popovic, Automatic rigging and animation of 3D characters, SIGGRAPH 2007: a template is embedded in the
inside of the mesh. Their search over packed spheres is replaced by ways along the middle of the volume, which find the
ends of the limbs directly.
"""

from dataclasses import dataclass, field

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.character.rigging.human import place_human
from muybridge.motion.character.rigging.landmarks import NoBody, find_landmarks
from muybridge.motion.character.rigging.orientation import Orientation, find_orientation, refine_offset
from muybridge.motion.character.rigging.repair import Repaired, repair
from muybridge.motion.character.rigging.templates import TEMPLATES, Template, joint_names
from muybridge.motion.character.rigging.volume import fill_volume

_COARSE, _FINE = 64, 150  # cells along the longest extent, and along the height


@dataclass(frozen=True)
class RigOptions:
    """How a mesh is rigged.

    Attributes:
        template: a key of `TEMPLATES`.
        rig: whose names the joints get, one of `templates.RIGS`.
        turn: whether a body that lies or faces elsewhere is stood up and turned to the front.
    """

    template: str = "human"
    rig: str = "muybridge"
    turn: bool = True


@dataclass(frozen=True, eq=False)
class MeshRig:
    """A skeleton in a mesh.

    Attributes:
        template: of the skeleton.
        names: of the joints.
        places: role -> (3,) metres in the new world.
        new_from_old: (4, 4) the world in which the body stands and faces -Y, from that of the mesh.
        inside_out: whether the faces of the mesh must be turned.
        notices: what was found and assumed, one sentence each.
    """

    template: Template
    names: tuple[str, ...]
    places: dict[str, FloatArray]
    new_from_old: FloatArray = field(default_factory=lambda: np.eye(4))
    inside_out: bool = False
    notices: tuple[str, ...] = ()

    @property
    def roles(self) -> dict[str, int]:
        """Role -> number of the joint."""
        return {role: j for j, role in enumerate(self.template.roles)}

    @property
    def parents(self) -> tuple[int, ...]:
        """(J,) -1 for the root."""
        number = self.roles
        return tuple(number.get(parent, -1) for parent in self.template.parents.values())

    @property
    def joints(self) -> FloatArray:
        """(J, 3) metres in the new world."""
        return np.stack([self.places[role] for role in self.template.roles])

    def skeleton(self) -> Skeleton:
        """The joints with axes along the world's, at rest in the mesh's pose."""
        joints, parents = self.joints, self.parents
        offsets = np.stack([joints[j] - joints[p] if p >= 0 else np.zeros(3) for j, p in enumerate(parents)])
        free = np.full((len(joints), 3), np.inf)
        return Skeleton(self.names, parents, offsets, np.full((len(joints), 3), np.nan), (2,) * len(joints), -free,
                        free)  # fmt: skip


def rig_mesh(vertices: FloatArray, triangles: IntArray, options: RigOptions | None = None) -> MeshRig:
    """Put a skeleton into a mesh.

    Args:
        vertices: (V, 3) metres, Z up.
        triangles: (F, 3).
        options: how.

    Raises:
        MuybridgeError: the mesh shows no body that the template fits.
    """
    options = options or RigOptions()
    if options.template not in TEMPLATES:
        raise MuybridgeError(f"unknown template {options.template!r}: valid are {', '.join(TEMPLATES)}")
    template = TEMPLATES[options.template]
    names = joint_names(template, options.rig)
    whole = repair(vertices, triangles)
    notices = _of_repair(whole)
    found = find_orientation(fill_volume(whole.vertices, whole.triangles, _COARSE))
    body = whole.vertices @ found.body_from_world[:3, :3].T + found.body_from_world[:3, 3]
    extent = np.ptp(body, axis=0)
    volume = fill_volume(body, whole.triangles, int(_FINE * extent.max() / extent[2]))
    shift = refine_offset(volume)
    volume = volume.moved(np.array([-shift, 0.0, 0.0]))
    try:
        places = place_human(find_landmarks(volume))
    except NoBody as error:
        raise MuybridgeError(f"the mesh shows no body with {template.limbs}: {error}", remedy="rig_template") from None
    world_from_body = np.linalg.inv(found.body_from_world)
    new_from_old, steps = _new_world(found, options)
    matrix = new_from_old @ world_from_body
    back = {role: matrix[:3, :3] @ (places[role] + [shift, 0.0, 0.0]) + matrix[:3, 3] for role in template.roles}
    return MeshRig(template, names, back, new_from_old, whole.inside_out, (*notices, *steps))


def _new_world(found: Orientation, options: RigOptions) -> tuple[FloatArray, tuple[str, ...]]:
    """(4, 4) the world in which the body stands, from the mesh's; and what is said of it."""
    if found.is_usual or not options.turn:
        return np.eye(4), ()
    return found.body_from_world, found.notes


def _of_repair(whole: Repaired) -> list[str]:
    out = []
    if whole.inside_out:
        out.append("the faces of the mesh pointed inwards and were turned")
    if whole.dropped:
        out.append(f"{whole.dropped} faces without area were passed over")
    return out
