"""Posing people for a scene: where they stand, what their hands hold, and how near they come to one another.

Someone at heading 0 faces -y, as in `train.synthesis.motions`. Metres and degrees.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.motions.rig import SIDES, SkinnedBody, forward, log, rot, skin
from muybridge.train.synthesis.motions.script import Script
from muybridge.train.synthesis.motions.solve import Solver
from muybridge.train.synthesis.motions.stage import Stage
from muybridge.train.synthesis.things.scene import Posed

SOFT = 0.02  # metres that bodies in contact may overlap: flesh and cloth give
PALM = 0.035  # metres from the skin that a hand touches to the wrist of the hand
# What is left out where bodies are kept apart: arms, which reach, and feet, which stand side by side.
_FREE = ("shoulder01", "upperarm", "lowerarm", "wrist", "finger", "metacarpal", "foot", "toe")
_ARM = ("clavicle", "shoulder01", "upperarm", "lowerarm", "wrist")
_FAR = 0.2  # metres between points of two bodies that say nothing about overlap
_STRIDES = (0.12, 0.03, 0.01)  # metres, of the approach


class Member:
    """A person of a scene while being posed.

    Args:
        body: the body model.
        rng: source of random numbers.
        age: range of anny's age, 0 newborn to 1 old; by default as `BodyModel.sample_phenotypes` draws.

    Attributes:
        script: the pose, one frame; see `motions.script.Script`.
        k: height relative to 1.7 m.
    """

    def __init__(self, body: BodyModel, rng: np.random.Generator, age: tuple[float, float] | None = None) -> None:
        self.body, self.rng = body, rng
        self.phenotypes, self.skeleton = body.sample_person(rng, age)
        self.solver = Solver(self.skeleton)
        self.k = self.skeleton.height / 1.7
        self.script = Script(np.zeros(1))
        self._shift = np.zeros((1, 3))
        self._hands = {s: body.poses.sample(1).rotvec[0] for s, _ in SIDES}
        self._normals = _normals(self.skeleton)

    def set(self, **channels: float) -> "Member":
        """Set channels of the script; a name of a limb's channel without L or R sets both."""
        for name, value in channels.items():
            for full in (name,) if name in self.script.channels else (name + "L", name + "R"):
                self.script[full] = value
        return self

    def vary(self, size: float = 1.0) -> "Member":
        """Small random changes of what nobody controls."""
        for name, sd in (("lean", 4), ("lateral", 4), ("twist", 5), ("nod", 10), ("tilt", 8), ("look", 18)):
            self.script[name] = self.script[name] + self.rng.normal(0, sd) * size
        for s, _ in SIDES:
            for name, sd in (("flex", 8), ("out", 7), ("elbow", 14), ("armtwist", 14), ("pro", 20), ("wrist", 15)):
                self.script[name + s] = self.script[name + s] + self.rng.normal(0, sd) * size
        return self

    def play(self, motion: Callable[[Stage], None], calm: float = 0.3) -> "Member":
        """Take the pose of a generator of motion (`motions.floor` and others) at a random time, at the origin."""
        stage = Stage(self.solver, self.script.time, self.rng, calm)
        motion(stage)
        self.script = stage.s
        return self

    def sit(self, x: float, y: float, heading: float, seat: float) -> "Member":
        """On a seat of that height at (x, y), feet on the floor in front of it."""
        leg, turn = self.skeleton.leg, rot(2, heading)
        self.set(x=x, y=y, yaw=heading, height=(seat + 0.10 * self.k) / float(self.skeleton.rest[0, 2]))
        self.set(pitch=self.rng.uniform(-14, 6), lean=self.rng.uniform(-4, 28))
        for s, sign in SIDES:
            foot = [sign * self.rng.uniform(0.06, 0.2), -self.rng.uniform(0.5, 0.72) * leg, 0.0]
            bx, by, _ = turn @ foot + [x, y, 0]
            yaw = heading + sign * self.rng.uniform(0, 15)
            self.set(**{"bx" + s: float(bx), "by" + s: float(by), "byaw" + s: yaw})
        return self

    def carried(self, x: float, y: float, z: float, heading: float) -> "Member":
        """Off the floor: the root at (x, y, z), legs by their angles."""
        return self.set(
            x=x, y=y, yaw=heading, height=z / float(self.skeleton.rest[0, 2]), plant=0.0, contact=0.0, balance=0.0
        )

    def lift(self) -> "Member":
        """Settle where the script puts the body, whatever is below."""
        self._shift = np.zeros((1, 3))
        self.local, self.root = self.solver.pose(self.script, self._shift)
        self._place()
        return self

    def stand(self, x: float, y: float, heading: float, width: float = 1.0, split: float = 0.0) -> "Member":
        """Feet on the floor below (x, y), `split` metres apart fore and aft, the left one in front if positive."""
        self.set(x=x, y=y, yaw=heading, balance=1.0)
        turn = rot(2, heading)
        for s, sign in SIDES:
            ball = self.solver.ball_at_rest(s) * [width * self.rng.uniform(0.85, 1.2), 1, 0]
            ball[1] -= 0.5 * sign * split
            bx, by, _ = turn @ ball + [x, y, 0]
            yaw = heading + sign * self.rng.uniform(0, 14)
            self.set(**{"bx" + s: float(bx), "by" + s: float(by), "byaw" + s: yaw})
        return self

    def settle(self, exact: bool = False) -> "Member":
        """Find where the pose puts the body: balanced, out of the floor. `exact`: what lies on the floor does."""
        if exact:
            self.local, self.root = self.solver.solve(self.script)
            height = self.script["height"][0] * self.skeleton.rest[0, 2]
            self._shift = self.root - [self.script["x"][0], self.script["y"][0], height]
        else:
            self._shift = np.zeros((1, 3))
            for _ in range(2):
                self.local, self.root = self.solver.pose(self.script, self._shift)
                rotations, at = forward(self.skeleton, self.local, self.root)
                self._shift = self._shift + self.solver._corrections(self.script, self.local, self.root, at)
            self.local, self.root = self.solver.pose(self.script, self._shift)
        self._place()
        return self

    def _place(self) -> None:
        self._rotations, self._origins = forward(self.skeleton, self.local, self.root)
        self.skin = skin(self.skeleton, self._rotations, self._origins)[0]

    def move(self, by: FloatArray) -> None:
        """Move the settled person by (3,), with what is planned for the feet."""
        for axis, name in enumerate("xyz"):
            for s, _ in SIDES:
                self.script["b" + name + s] = self.script["b" + name + s] + by[axis]
                self.script["h" + name + s] = self.script["h" + name + s] + by[axis]
        self.script["x"], self.script["y"] = self.script["x"] + by[0], self.script["y"] + by[1]
        self._shift = self._shift + [0, 0, by[2]]
        self.root = self.root + by
        self._origins, self.skin = self._origins + by, self.skin + by

    def at(self, bone: str, offset: Sequence[float] = (0.0, 0.0, 0.0)) -> FloatArray:
        """(3,) world: the point that at rest is `offset` from the origin of `bone`, for a person of 1.7 m."""
        i = self.skeleton.index(bone)
        return np.asarray(self._origins[0, i] + self._rotations[0, i] @ (np.array(offset) * self.k))

    def spot(self, bone: str, toward: ArrayLike, out: float = PALM) -> FloatArray:
        """(3,) world: `out` metres over the skin where a ray from the origin of `bone` in the direction `toward` (axes
        of the body at rest) leaves the body."""
        i = self.skeleton.index(bone)
        way = np.asarray(toward, float)
        way = way / np.linalg.norm(way)
        offset = self.skeleton.surface - self.skeleton.rest[i]
        along = offset @ way
        aside = np.linalg.norm(offset - along[:, None] * way, axis=1)
        chosen = int((along - 2.5 * aside - 9.0 * (along > 0.26 * self.k)).argmax())
        turn = self._rotations[0, self.skeleton.strongest[chosen]]
        return np.asarray(self.skin[chosen] + turn @ way * out)

    def reach(self, **places: FloatArray) -> "Member":
        """Bring the wrists `L` and `R` of a settled person to places (3,) world; elbows point where the script's angles
        put them."""
        for side, place in places.items():
            self.set(**{"hand" + side: 1.0} | {f"h{a}{side}": float(v) for a, v in zip("xyz", place, strict=True)})
        local, _ = self.solver.pose(self.script, self._shift)
        moved = [i for i, b in enumerate(self.skeleton.bones) if b.startswith(_ARM) and b[-1] in places]
        self.local[:, moved] = local[:, moved]
        self._place()
        return self

    def outside(self, legs: bool = True) -> "Outside":
        """The skin as it is now, without arms and feet, or without legs, too."""
        free = _FREE if legs else (*_FREE, "upperleg", "lowerleg")
        bone = self.skeleton.strongest
        kept = np.array([not b.startswith(free) for b in self.skeleton.bones])[bone]
        normals = (self._rotations[0, bone[kept]] @ self._normals[kept][..., None])[..., 0]
        return Outside(self.skin[kept], normals, cKDTree(self.skin[kept]))

    def posed(self) -> Posed:
        """The person as the scene needs it, with hands of the static sampler."""
        rotvec = log(self.local)[0]
        for s, _ in SIDES:
            for i, bone in enumerate(self.skeleton.bones):
                if bone.startswith("finger") and bone.endswith("." + s):
                    rotvec[i] = self._hands[s][i]
        vertices, landmarks, _, joints = self.body.forward(rotvec[None], self.phenotypes[None])
        shift = (self.root[0] - joints[0, 0]).astype(np.float32)
        gender = float(self.body.gender(self.phenotypes))
        return Posed(vertices[0] + shift, landmarks[0] + shift, gender)


def _normals(skeleton: SkinnedBody, neighbours: int = 8) -> FloatArray:
    """(P, 3) outward normals of the skin's points at rest, from their neighbours."""
    points = skeleton.surface
    _, near = cKDTree(points).query(points, neighbours)
    spread = points[near] - points[near].mean(1, keepdims=True)
    normals = np.linalg.svd(spread, full_matrices=False)[2][:, 2]
    inside = skeleton.rest[skeleton.strongest]
    child = np.full(len(skeleton.bones), -1)
    for i, parent in enumerate(skeleton.parents):
        if parent >= 0 and child[parent] < 0:
            child[parent] = i
    end = skeleton.rest[np.where(child < 0, np.arange(len(child)), child)][skeleton.strongest]
    axis = end - inside
    share = np.clip(((points - inside) * axis).sum(1) / ((axis**2).sum(1) + 1e-9), 0, 1)
    away = points - inside - share[:, None] * axis
    return np.asarray(normals * np.where((normals * away).sum(1) < 0, -1, 1)[:, None])


@dataclass(frozen=True)
class Outside:
    """Points of a body's skin (P, 3), their outward normals (P, 3), and a search tree of the points."""

    points: FloatArray
    normals: FloatArray
    tree: cKDTree

    def overlap(self, other: "Outside", by: FloatArray) -> float:
        """The deepest that the skin of one lies in the other, this one moved by (3,), metres; negative if apart."""
        return max(_depth(self.points + by, other), _depth(other.points - by, self))


def _depth(points: FloatArray, body: Outside) -> float:
    """The deepest that `points` (P, 3) lie in `body`."""
    distance, nearest = body.tree.query(points, distance_upper_bound=_FAR)
    near = np.isfinite(distance)
    if not near.any():
        return -_FAR
    nearest = nearest[near]
    return float(-((points[near] - body.points[nearest]) * body.normals[nearest]).sum(1).min())


def bring_together(
    mover: Member,
    others: Sequence[Member],
    way: ArrayLike,
    start: float,
    least: float = 0.0,
    soft: float = SOFT,
    legs: bool = True,
) -> None:
    """Move a settled person `start` metres along `way` (3,) and back until touching one of `others` (or the floor, if
    from above), or until `least` metres remain; legs may touch if not `legs`."""
    step = np.array(way, float)
    step /= np.linalg.norm(step)
    me, them = mover.outside(legs), [o.outside() for o in others]
    bottom = mover.skin[:, 2].min() if step[2] else np.inf

    def touches(left: float) -> bool:
        return bottom + left * step[2] < 0 or any(me.overlap(o, step * left) > soft for o in them)

    left = start
    for stride in _STRIDES:
        while left - stride > least and not touches(left - stride):
            left -= stride
    mover.move(step * left)


def push_apart(mover: Member, others: Sequence[Member], way: FloatArray, gap: float) -> None:
    """Move a settled person along `way` (3,) until nobody is touched, reaching arms apart, and `gap` metres more."""
    reach = max(float(np.linalg.norm(o.root[0] - mover.root[0])) for o in others) + 1.2
    bring_together(mover, others, tuple(way), reach)
    mover.move(way / np.linalg.norm(way) * gap)
