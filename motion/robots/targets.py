"""Where a robot's points should be, and how its links should be turned, for it to move as a person does; its soles.

Limbs have the person's directions and the robot's lengths; the root's path is scaled by the legs; feet stand where the
person's do, flat where these are, and turn over their front edge as these roll over their balls.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.numerics.rotations import exp_so3, log_so3
from muybridge.motion.contacts.blending import blend
from muybridge.motion.contacts.footskate import contact_spans
from muybridge.motion.retargeting.grounding import Ground, level_feet
from muybridge.motion.retargeting.rig import Posed, Rig
from muybridge.motion.robots.link_roles import SIDES, Limb, LinkRoles
from muybridge.motion.robots.robot import Robot, Shape

BLEND_S = 0.25  # over which a foot comes from where the scaled person has it to where it stands
# Standard deviations of what pulls: metres on a robot with legs of one metre, radians.
_SIGMA_M = {"hips": 0.03, "knee": 0.05, "heel": 0.03, "ball": 0.03, "elbow": 0.03, "wrist": 0.02, "hand": 0.05}
_SIGMA_TURN = {"hips": 0.1, "chest": 0.1, "head": 0.3, "foot": 0.15}
_PLANTED_M, _FLAT = 0.0004, 0.01
_LEAN = 0.5  # share of a bend of the trunk that hips take over where the waist cannot
_LONG, _BEHIND, _WIDE, _HIGH = 0.28, 0.3, 0.1, 0.08  # of a leg: a foot without shapes, what is behind the ankle, ankle
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class RobotSole:
    """The sole of a foot that is level at rest; in the world at rest.

    Attributes:
        heel: (3,) metres, the middle of its back edge.
        ball: (3,) metres, the middle of its front edge, over which the foot rolls.
        corners: (4, 3) metres.
        ankle_height: metres of the ankle over the sole.
        estimated: whether the file has no shapes for it.
    """

    heel: FloatArray
    ball: FloatArray
    corners: FloatArray
    ankle_height: float
    estimated: bool


def find_sole(robot: Robot, limb: Limb, axes: FloatArray) -> RobotSole:
    """The sole of a leg's foot.

    Args:
        robot: at rest with level feet.
        limb: the leg.
        axes: (3, 3) columns: left, back and up in the world at rest.
    """
    turns, places = robot.at_rest()
    links = [k for k in range(len(robot)) if _carried_by(robot, k, limb.end)]
    ahead, across = -axes[:, 1], axes[:, 0]
    shapes = [s for s in robot.shapes if s.link in links]
    shapes = [s for s in shapes if s.solid] or shapes

    def reach(direction: FloatArray) -> float:
        return max(_support(s, turns[s.link], places[s.link], direction) for s in shapes)

    ankle = limb.points[2]
    leg = float(np.linalg.norm(np.diff(limb.points[:3], axis=0), axis=1).sum())
    if shapes:
        low, front, back = -reach(-_UP), reach(ahead), -reach(-ahead)
        left, right = reach(across), -reach(-across)
    else:
        ends = np.array([places[k] for k in links])
        low = (
            min(float(ends[:, 2].min()), float(ankle[2]) - 0.01 * leg)
            if len(links) > 1
            else float(ankle[2]) - _HIGH * leg
        )
        back = float(ankle @ ahead) - _BEHIND * _LONG * leg
        front = max(back + _LONG * leg, float((ends @ ahead).max()))
        aside = float(places[limb.end] @ across)
        left, right = aside + _WIDE * leg / 2, aside - _WIDE * leg / 2
    middle = across * (left + right) / 2 + _UP * low

    def corner(x: float, y: float) -> FloatArray:
        return np.asarray(ahead * x + across * y + _UP * low)

    corners = np.stack([corner(x, y) for x in (back, front) for y in (left, right)])
    return RobotSole(middle + ahead * back, middle + ahead * front, corners, float(ankle[2]) - low, not shapes)


def _support(shape: Shape, turn: FloatArray, place: FloatArray, direction: FloatArray) -> float:
    return shape.support(direction @ turn) + float(place @ direction)


def _carried_by(robot: Robot, link: int, foot: int) -> bool:
    """Whether a link is the foot, or fixed to it."""
    moved = {joint.link for joint in robot.joints}
    while link != foot:
        if link in moved or link < 0:
            return False
        link = robot.parents[link]
    return True


@dataclass(frozen=True, eq=False)
class Targets:
    """What a robot is solved for.

    Attributes:
        names: of the points.
        links: (P,) link of each point.
        points: (P, 3) metres in the link's frame.
        places: (T, P, 3) metres in the world.
        weights: (T, P) inverse variances.
        turned: (O,) links.
        turns: (T, O, 3, 3) world from link.
        turn_weights: (T, O).
        contact: (T, 2, 2) of heel and ball, left and right.
        scale: metres of the robot per unit of the person's path.
    """

    names: tuple[str, ...]
    links: IndexArray
    points: FloatArray
    places: FloatArray
    weights: FloatArray
    turned: IndexArray
    turns: FloatArray
    turn_weights: FloatArray
    contact: BoolArray
    scale: float


def make_targets(
    robot: Robot, parts: LinkRoles, soles: tuple[RobotSole, RobotSole], rig: Rig, posed: Posed, ground: Ground,
    fps: float,
) -> Targets:  # fmt: skip
    """The targets of a take.

    Args:
        robot: that is to move.
        parts: of it.
        soles: of its left and right foot.
        rig: of the person.
        posed: the person over time.
        ground: contacts and floor of the person.
        fps: frames per second.
    """
    builder = _Builder(robot, parts, rig, posed)
    contact = ground.contacts.contact
    facing = level_feet(posed.turns, rig, contact, fps, BLEND_S)
    builder.trunk(ground, soles)
    for k, side in enumerate(SIDES):
        builder.leg(side, soles[k], facing[:, rig.roles[f"{side}_foot"]], contact[:, k], fps)
        builder.arm(side)
    return builder.targets(contact)


class _Builder:
    def __init__(self, robot: Robot, parts: LinkRoles, rig: Rig, posed: Posed):
        self.robot, self.parts, self.rig, self.posed = robot, parts, rig, posed
        self.turns, self.places = robot.at_rest()
        leg, arm = (parts.limbs[f"left_{kind}"].points for kind in ("leg", "arm"))
        self.size = float(np.linalg.norm(np.diff(leg[:3], axis=0), axis=1).sum())
        self.scale = self.size / rig.leg_length()
        self.rows: list[tuple[str, int, FloatArray, FloatArray, FloatArray]] = []
        self.facings: list[tuple[int, FloatArray, FloatArray]] = []

    def of_person(self, role: str) -> FloatArray:
        """(T, 3, 3) that a vector of the robot at rest turns by, to be as a joint of the person is."""
        return np.asarray(self.posed.turns[:, self.rig.roles[role]] @ self.parts.axes.T)

    def direction(self, start: str, stop: str) -> FloatArray:
        """(T, 3) unit vectors between two joints of the person."""
        way = self.posed.places[:, self.rig.roles[stop]] - self.posed.places[:, self.rig.roles[start]]
        return np.asarray(way / np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-9))

    def add(
        self, name: str, link: int, at_rest: FloatArray, places: FloatArray, planted: BoolArray | None = None
    ) -> None:
        """A point of a link, by where it is at rest."""
        own = (at_rest - self.places[link]) @ self.turns[link]
        part = name.split("_")[-1]
        weight = np.full(len(places), 1 / (_SIGMA_M[part] * self.size) ** 2)
        if planted is not None:
            weight = np.where(planted, 1 / (_PLANTED_M * self.size) ** 2, weight)
        self.rows.append((name, link, own, places, weight))

    def face(self, part: str, link: int, turns: FloatArray, firm: BoolArray | None = None) -> None:
        """How a link should be turned, by how vectors at rest are."""
        weight = np.full(len(turns), 1 / _SIGMA_TURN[part] ** 2)
        if firm is not None:
            weight = np.where(firm, 1 / _FLAT**2, weight)
        self.facings.append((link, turns @ self.turns[link], weight))

    def trunk(self, ground: Ground, soles: tuple[RobotSole, RobotSole]) -> None:
        """Hips, chest and head; limbs begin where these put them."""
        parts, rig = self.parts, self.rig
        thighs = [rig.roles[f"{side}_thigh"] for side in SIDES]
        middle = self.posed.places[:, thighs].mean(axis=1)
        ankle = float(np.mean([sole.ankle_height for sole in soles]))
        height = (self.size + ankle) / (rig.leg_length() + max(ground.ankle, 0.0))
        hips = np.stack([*(middle[:, :2] * self.scale).T, (middle[:, 2] - ground.height) * height], axis=1)
        pelvis, chest = self._spine()
        centre = np.mean([parts.limbs[f"{side}_leg"].points[0] for side in SIDES], axis=0)
        self.add("hips", parts.hips, centre, hips)
        self.face("hips", parts.hips, pelvis)
        if parts.chest != parts.hips:
            self.face("chest", parts.chest, chest)
        if parts.head >= 0 and "head" in rig.roles:
            self.face("head", parts.head, self.of_person("head"))
        pivot = self._waist(centre)
        waist = hips + pelvis @ (pivot - centre)
        self.starts = {}
        for side in SIDES:
            self.starts[f"{side}_leg"] = hips + pelvis @ (parts.limbs[f"{side}_leg"].points[0] - centre)
            self.starts[f"{side}_arm"] = waist + chest @ (parts.limbs[f"{side}_arm"].points[0] - pivot)

    def _waist(self, centre: FloatArray) -> FloatArray:
        above, link = [], self.parts.chest
        while link >= 0 and link != self.parts.hips:
            above.append(self.places[link])
            link = self.robot.parents[link]
        return np.mean(above, axis=0) if above and len(self.parts.waist) else centre

    def _spine(self) -> tuple[FloatArray, FloatArray]:
        """(T, 3, 3) twice: hips and chest as far as the waist can follow; hips lean with what it cannot."""
        pelvis = self.of_person("hips")
        chest = self.posed.turns[:, self._trunk_joint()] @ self.parts.axes.T
        bend = log_so3(np.swapaxes(pelvis, -1, -2) @ chest)
        axes = self.parts.waist
        able = np.linalg.pinv(axes, rcond=1e-3) @ axes if len(axes) else np.zeros((3, 3))
        pelvis = pelvis @ exp_so3(_LEAN * (bend - bend @ able))
        return pelvis, np.asarray(pelvis @ exp_so3(bend @ able))

    def _trunk_joint(self) -> int:
        """The joint of the person that both arms hang from."""
        one, other = (self.rig.above(self.rig.roles[f"{side}_upper_arm"])[1:] for side in SIDES)
        return next(j for j in one if j in other)

    def leg(self, side: str, sole: RobotSole, foot: FloatArray, contact: BoolArray, fps: float) -> None:
        """Knee, and heel and ball of the foot."""
        limb = self.parts.limbs[f"{side}_leg"]
        upper, lower = np.linalg.norm(np.diff(limb.points[:3], axis=0), axis=1)
        knee = self.starts[f"{side}_leg"] + self.direction(f"{side}_thigh", f"{side}_shin") * upper
        ankle = knee + self.direction(f"{side}_shin", f"{side}_foot") * lower
        turn = _straight(foot @ self.parts.axes.T, sole.ball - sole.heel, contact, fps)
        heel, ball = (ankle + turn @ (point - limb.points[2]) for point in (sole.heel, sole.ball))
        size = float(np.linalg.norm(sole.heel - sole.ball))
        stands, stood = np.asarray(contact.any(-1)), np.zeros((len(heel), 2, 3))
        for a, b in contact_spans(stands):
            stood[a:b] = _stance(heel[a:b], ball[a:b], contact[a:b], size)
        shift = np.where(contact[:, 1:], stood[:, 1] - ball, stood[:, 0] - heel)
        shift = blend(shift, stands.astype(np.float64), fps, BLEND_S)
        heel = np.where(contact[:, :1], stood[:, 0], heel + shift)
        ball = np.where(contact[:, 1:], stood[:, 1], ball + shift)
        self.add(f"{side}_knee", limb.middle, limb.points[1], knee)
        self.add(f"{side}_heel", limb.end, sole.heel, heel, contact[:, 0])
        self.add(f"{side}_ball", limb.end, sole.ball, ball, contact[:, 1])
        self.face("foot", limb.end, turn, np.asarray(contact.all(-1)))

    def arm(self, side: str) -> None:
        """Elbow, wrist and, where the wrist bends, the hand's end."""
        limb, rig = self.parts.limbs[f"{side}_arm"], self.rig
        upper, lower = np.linalg.norm(np.diff(limb.points[:3], axis=0), axis=1)
        elbow = self.starts[f"{side}_arm"] + self.direction(f"{side}_upper_arm", f"{side}_forearm") * upper
        wrist = elbow + self.direction(f"{side}_forearm", f"{side}_hand") * lower
        self.add(f"{side}_elbow", limb.middle, limb.points[1], elbow)
        self.add(f"{side}_wrist", limb.end, limb.points[2], wrist)
        length = float(np.linalg.norm(limb.points[3] - limb.points[2]))
        if limb.wrist and length > 0.02 * self.size:
            forearm, hand = (rig.roles[f"{side}_{part}"] for part in ("forearm", "hand"))
            rest = rig.places[hand] - rig.places[forearm]
            ahead = self.posed.turns[:, hand] @ (rest / np.linalg.norm(rest))
            self.add(f"{side}_hand", limb.end, limb.points[3], wrist + ahead * length)

    def targets(self, contact: BoolArray) -> Targets:
        names, links, points, places, weights = zip(*self.rows, strict=True)
        turned, turns, turn_weights = zip(*self.facings, strict=True)
        return Targets(
            names, np.array(links, np.int64), np.array(points), np.stack(places, axis=1), np.stack(weights, axis=1),
            np.array(turned, np.int64), np.stack(turns, axis=1), np.stack(turn_weights, axis=1), contact, self.scale,
        )  # fmt: skip


def _straight(turn: FloatArray, along: FloatArray, contact: BoolArray, fps: float) -> FloatArray:
    """(T, 3, 3) with one heading in each contact: that of the frames in which the foot is flat."""
    way = (turn @ along)[:, :2]
    change = np.zeros((len(turn), 3))
    for a, b in contact_spans(np.asarray(contact.any(-1))):
        usual = _heading(way[a:b], contact[a:b])
        gap = np.arctan2(way[a:b, 0] * usual[1] - way[a:b, 1] * usual[0], way[a:b] @ usual)
        change[a:b, 2] = np.where(contact[a:b].all(-1) | ~contact[a:b].all(-1).any(), gap, 0.0)
    firm = np.abs(change[:, 2]) > 0
    return np.asarray(exp_so3(blend(change, firm.astype(np.float64), fps, BLEND_S)) @ turn)


def _heading(way: FloatArray, contact: BoolArray) -> FloatArray:
    """(2,) the mean direction of a foot (T, 2) over the floor while it is flat, or while it stands."""
    flat = contact.all(-1)
    way = way[flat if flat.any() else np.ones(len(way), np.bool_)]
    way = (way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)).mean(axis=0)
    return np.asarray(way / max(float(np.linalg.norm(way)), 1e-9))


def _stance(heel: FloatArray, ball: FloatArray, contact: BoolArray, length: float) -> FloatArray:
    """(T, 2, 3) metres: where heel and ball of a foot stand during one contact, on the floor.

    Args:
        heel: (T, 3) metres, where they would be.
        ball: (T, 3).
        contact: (T, 2) of both.
        length: metres between them.
    """
    flat = contact.all(-1)
    some = flat if flat.any() else np.ones(len(heel), np.bool_)
    way = _heading((ball - heel)[:, :2], contact) * length
    front = contact[some, 1].any()
    middle = np.median((ball if front else heel)[some, :2], axis=0)
    out = np.zeros((len(heel), 2, 3))
    out[:, 0, :2], out[:, 1, :2] = (middle - way, middle) if front else (middle, middle + way)
    return out
