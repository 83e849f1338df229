"""A skeleton for a mesh: repair, orientation, volume, landmarks, joints.

After Baran and Popovic, Automatic rigging and animation of 3D characters, SIGGRAPH 2007: a template is embedded in the
inside of the mesh. Their search over packed spheres is replaced by ways along the middle of the volume, which find the
ends of the limbs directly.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.character.rigging.checks import check_body
from muybridge.motion.character.rigging.landmarks import Landmarks, NoBody, find_landmarks
from muybridge.motion.character.rigging.orientation import Orientation, find_orientation, refine_offset
from muybridge.motion.character.rigging.placement.fingers import place_fingers
from muybridge.motion.character.rigging.placement.learned import RigNetwork, agreed, learned_places
from muybridge.motion.character.rigging.placement.people import place_people
from muybridge.motion.character.rigging.placement.quadruped import place_quadruped
from muybridge.motion.character.rigging.placement.stylised import is_person, place_stylised
from muybridge.motion.character.rigging.props import find_props, holders, without_islands
from muybridge.motion.character.rigging.repair import Repaired, repair
from muybridge.motion.character.rigging.templates import TEMPLATES, Template, joint_names
from muybridge.motion.character.rigging.volume import Volume, fill_volume

_COARSE, _FINE = 64, 150  # cells along the longest extent, and along the height
_MOST = 300  # cells along the longest extent
_LEAST_FACES = 20
_FLAT = 0.01  # of the largest spread of the vertices, the smallest below which they show no body
_DEEP, _NEAR = 1.4, 8  # cells from the surface that a joint is at least, and how far it may be moved for that
_SYMMETRIC = 0.93  # share of the volume that is mirrored, below which the plane of symmetry may be a wrong one
_SLACK = 0.005  # of that share, by which it may fall when props are left out


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
        held: (N,) of the mesh's vertices, the joint that each is rigid to, -1 for those of the body; empty for none.
        inside_out: whether the faces of the mesh must be turned.
        notices: what was found and assumed, one sentence each.
    """

    template: Template
    names: tuple[str, ...]
    places: dict[str, FloatArray]
    new_from_old: FloatArray = field(default_factory=lambda: np.eye(4))
    inside_out: bool = False
    held: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
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


def rig_mesh(
    vertices: FloatArray, triangles: IntArray, options: RigOptions | None = None, network: RigNetwork | None = None
) -> MeshRig:
    """Put a skeleton into a mesh.

    Args:
        vertices: (V, 3) metres, Z up.
        triangles: (F, 3).
        options: how.
        network: a second opinion on where the joints of people are; None: they are measured alone. Figures with the
            proportions of cartoons are always measured alone.

    Raises:
        MuybridgeError: the mesh shows no body that the template fits.
    """
    options = options or RigOptions()
    if options.template not in TEMPLATES:
        raise MuybridgeError(f"unknown template {options.template!r}: valid are {', '.join(TEMPLATES)}")
    template = TEMPLATES[options.template]
    if template.name == "quadruped" and options.rig != "muybridge":
        raise MuybridgeError(f"the names of {options.rig} are for people; a quadruped has those of muybridge")
    names = joint_names(template, options.rig)
    whole = repair(vertices, triangles)
    if len(whole.triangles) < _LEAST_FACES:
        raise MuybridgeError(f"only {len(whole.triangles)} of its faces have an area, which show no body",
                             remedy="mesh_repair")  # fmt: skip
    spans = np.linalg.svd(whole.vertices - whole.vertices.mean(axis=0), full_matrices=False)[1]
    if spans[2] < _FLAT * spans[0]:
        raise MuybridgeError("is flat, which shows no body", remedy="mesh_repair")
    found, body, props = _stand(whole)
    try:
        check_body(_in_body(body, found, 0.0), body.triangles, template.name == "quadruped")
        volume, shift = _fine_volume(body, found)
        places, fitted = _embed(volume, template, body.triangles, _in_body(body, found, shift), network)
    except NoBody as error:
        raise MuybridgeError(f"the mesh shows no body with {template.limbs}: {error}",
                             remedy="rig_quadruped" if error.four_legs else "rig_template") from None  # fmt: skip
    places = {role: place if role[-1:].isdigit() else _inside(volume, place) for role, place in places.items()}
    new_from_old, steps = _new_world(found, options)
    matrix = new_from_old @ np.linalg.inv(found.body_from_world)
    back = {role: matrix[:3, :3] @ (places[role] + [shift, 0.0, 0.0]) + matrix[:3, 3] for role in template.roles}
    rig = MeshRig(template, names, back, new_from_old, whole.inside_out)
    held = holders(
        whole, props, rig.joints, _hands(template), whole.vertices @ new_from_old[:3, :3].T + new_from_old[:3, 3]
    )
    notices = (*_of_repair(whole), *steps, *fitted, *_of_props(held, names))
    return replace(rig, held=held, notices=notices)


def rig_of_joints(
    vertices: FloatArray, triangles: IntArray, places: dict[str, FloatArray], new_from_old: FloatArray,
    options: RigOptions,
) -> MeshRig:  # fmt: skip
    """The skeleton whose joints are all known; nothing is searched for.

    Args:
        vertices: (V, 3) metres, Z up.
        triangles: (F, 3).
        places: role -> (3,) metres in the new world, of every joint of the template.
        new_from_old: (4, 4) the new world from that of the mesh.
        options: template and names.
    """
    template = TEMPLATES[options.template]
    whole = repair(vertices, triangles)
    return MeshRig(template, joint_names(template, options.rig), {r: places[r] for r in template.roles}, new_from_old,
                   whole.inside_out, notices=tuple(_of_repair(whole)))  # fmt: skip


def standing_volume(vertices: FloatArray, triangles: IntArray) -> tuple[Landmarks, FloatArray]:
    """The landmarks of a body, and (4, 4) its own frame from the mesh's.

    Args:
        vertices: (V, 3) metres.
        triangles: (F, 3).

    Raises:
        NoBody: no body with two legs and two arms.
    """
    found, body, _ = _stand(repair(vertices, triangles))
    volume, shift = _fine_volume(body, found)
    matrix = found.body_from_world.copy()
    matrix[0, 3] -= shift
    return find_landmarks(volume), matrix


def _fine_volume(body: Repaired, found: Orientation) -> tuple[Volume, float]:
    """The volume in the body's own frame, and metres by which its plane of symmetry was still off."""
    placed = body.vertices @ found.body_from_world[:3, :3].T + found.body_from_world[:3, 3]
    extent = np.ptp(placed[np.unique(body.triangles)], axis=0)
    volume = fill_volume(placed, body.triangles, min(int(_FINE * max(extent.max() / extent[2], 1.0)), _MOST))
    shift = refine_offset(volume)
    return volume.moved(np.array([-shift, 0.0, 0.0])), shift


def _stand(whole: Repaired) -> tuple[Orientation, Repaired, BoolArray]:
    """How a body stands, its surface without what it holds, and which islands that is."""
    coarse = fill_volume(whole.vertices, whole.triangles, _COARSE)
    if coarse.bodies > 1:
        raise MuybridgeError(f"shows {coarse.bodies} bodies apart from each other; save each in a file of its own")
    best, none = find_orientation(coarse), np.zeros(int(whole.island.max()) + 1, np.bool_)
    if len(none) == 1:
        return best, whole, none
    out = best, whole, none
    tried = [best]
    if best.symmetry < _SYMMETRIC:
        tried.append(find_orientation(coarse, np.array([1.0, 0.0, 0.0])))
    for first in tried:
        props = find_props(whole, coarse, first.body_from_world)
        if props.any():
            rest = without_islands(whole, props)
            again = find_orientation(fill_volume(rest.vertices, rest.triangles, _COARSE))
            if again.symmetry > out[0].symmetry - _SLACK:
                out = again, rest, props
    return out


def _in_body(body: Repaired, found: Orientation, shift: float) -> FloatArray:
    """(V, 3) metres of a surface in the body's own frame."""
    matrix = found.body_from_world
    return body.vertices @ matrix[:3, :3].T + matrix[:3, 3] - [shift, 0.0, 0.0]


def _embed(
    volume: Volume, template: Template, triangles: IntArray, vertices: FloatArray, network: RigNetwork | None
) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Role -> (3,) metres in the body's frame, and what was assumed."""
    if template.name == "quadruped":
        return place_quadruped(volume), ()
    marks = find_landmarks(volume)
    person = is_person(marks)
    places = place_people(marks) if person else place_stylised(marks)
    if network is not None and person:  # it knows figures with other proportions no better than the shape does
        places = agreed(places, learned_places(vertices, triangles, network))
    notes = [] if person else ["its proportions are no person's, so joints follow its shape alone"]
    if "left_index_1" in template.parents:
        seen = []
        for side, arm in zip(("left", "right"), marks.arms, strict=True):
            tip, wrist = arm.way.points[0], places[f"{side}_hand"]
            found, apart = place_fingers(vertices, triangles, wrist, tip, np.array([0.0, -1.0, 0.0]))
            places |= {f"{side}_{name}": place for name, place in found.items()}
            seen.append(apart)
        if not all(seen):
            notes.append("five fingers of a hand are not apart, so their joints have usual proportions")
    return places, tuple(notes)


def _inside(volume: Volume, place: FloatArray) -> FloatArray:
    """A joint, moved to the nearest cell that is well inside where it is outside or on the surface."""
    cell = volume.cell_of(place)
    if volume.radius[tuple(cell)] >= _DEEP * volume.cell:
        return place
    low, high = np.maximum(cell - _NEAR, 0), np.minimum(cell + _NEAR + 1, volume.inside.shape)
    box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
    near = np.argwhere(volume.radius[box] >= _DEEP * volume.cell) + low
    if not len(near):
        return place
    centres = volume.centres(near)
    return np.asarray(centres[np.argmin(((centres - place) ** 2).sum(axis=1))])


def _hands(template: Template) -> tuple[int, ...]:
    return tuple(j for j, role in enumerate(template.roles) if role.endswith("_hand"))


def _new_world(found: Orientation, options: RigOptions) -> tuple[FloatArray, tuple[str, ...]]:
    """(4, 4) the world in which the body stands, from the mesh's; and what is said of it."""
    if found.is_usual or not options.turn:
        return np.eye(4), ()
    return found.body_from_world, found.notes


def _of_props(held: IntArray, names: tuple[str, ...]) -> list[str]:
    on = ", ".join(sorted({names[j] for j in held[held >= 0]}))
    return [f"what it holds on one side is rigid to {on}"] if on else []


def _of_repair(whole: Repaired) -> list[str]:
    out = []
    if whole.inside_out:
        out.append("the faces of the mesh pointed inwards and were turned")
    if whole.dropped:
        out.append(f"{whole.dropped} faces without area were passed over")
    return out
