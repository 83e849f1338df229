"""Which links of a robot are pelvis, trunk, head, legs and arms: by the shape of the tree, whatever names say."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import MuybridgeError
from muybridge.motion.robots.capsules import bone_ends
from muybridge.motion.robots.robot import Joint, Robot

SIDES = ("left", "right")
_HAND = 0.22  # of the robot's height: what branches into shorter ends is a hand or a foot
_TWIST = 0.8  # cosine between an axis and its bone above which the joint twists
_LEAST_JOINTS = 3  # of a limb
_LEVEL = 0.15  # of the robot's height: legs that end higher or lower than others are none of four
_PARTS = {"leg": ("thigh", "shin", "foot"), "arm": ("upper_arm", "forearm", "hand")}
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Limb:
    """A leg or an arm; points are in the world, at rest.

    Attributes:
        links: that joints move, from the trunk to the end.
        base: link of the trunk that it hangs from.
        middle: link below the knee or elbow.
        end: foot or hand.
        points: (4, 3) metres: hip, knee, ankle and the foot's end; or shoulder, elbow, wrist and the hand's end.
        wrist: whether joints between the middle and the end do more than twisting.
    """

    links: tuple[int, ...]
    base: int
    middle: int
    end: int
    points: FloatArray
    wrist: bool


@dataclass(frozen=True, eq=False)
class LinkRoles:
    """A humanoid robot's parts.

    Attributes:
        axes: (3, 3) columns: the body's left, back and up in the world at rest.
        hips: link that the legs hang from.
        chest: link that the arms hang from.
        head: link of the head; -1 where none moves.
        limbs: `left_leg`, `right_leg`, `left_arm`, `right_arm`.
        waist: (N, 3) unit axes, in the world at rest, of the joints between hips and chest.
        how: `geometry` or `map`.
    """

    axes: FloatArray
    hips: int
    chest: int
    head: int
    limbs: dict[str, Limb]
    waist: FloatArray
    how: str

    def table(self, robot: Robot) -> dict[str, str]:
        """Role -> name of the link, as a map has it."""
        out = {"hips": robot.links[self.hips]}
        if self.chest != self.hips:
            out["chest"] = robot.links[self.chest]
        if self.head >= 0:
            out["head"] = robot.links[self.head]
        for side in SIDES:
            for kind, parts in _PARTS.items():
                limb = self.limbs[f"{side}_{kind}"]
                links = (limb.links[0], limb.middle, limb.end)
                named = {f"{side}_{part}": robot.links[k] for part, k in zip(parts, links, strict=True)}
                out |= named if limb.end != limb.middle else dict(list(named.items())[:2])
        return out


def find_link_roles(robot: Robot, map: Mapping[str, str] | None = None) -> LinkRoles:
    """The parts of a humanoid robot, from its file's own pose.

    Args:
        robot: whose file's own pose stands with Z up.
        map: role -> link: `hips`, `left_thigh` (first link of the leg), `left_shin` (link below the knee), `left_foot`,
            `left_upper_arm`, `left_forearm`, `left_hand` (none where the forearm is the arm's last link) and the same
            on the right; `chest` and `head` if wanted. It is complete: nothing else is looked for.

    Raises:
        MuybridgeError: there are no two legs and two arms, or the map does not fit the tree.
    """
    turns, places = robot.at_rest()
    body = _Body(robot, turns, places)
    chains = _of_map(body, map) if map else _of_geometry(body)
    limbs = {name: body.limb(chain, middle) for name, (chain, middle) in chains.items()}
    axes = _axes(body, limbs)
    if not map and float((limbs["left_leg"].points[0] - limbs["right_leg"].points[0]) @ axes[:, 0]) < 0:
        limbs = {("right" if n.startswith("left") else "left") + n[n.index("_") :]: limb for n, limb in limbs.items()}
    limbs = _sides_of_arms(limbs, axes) if not map else limbs
    hips, chest = limbs["left_leg"].base, limbs["left_arm"].base
    if map:
        hips, chest = body.index(map.get("hips", robot.links[hips])), body.index(map.get("chest", robot.links[chest]))
        head = body.index(map["head"]) if "head" in map else -1
    else:
        head = body.head(chest, limbs)
    line = body.path(chest)
    waist = [body.axis(joint) for joint in robot.joints if joint.link in line and joint.link not in body.path(hips)]
    return LinkRoles(axes, hips, chest, head, limbs, np.array(waist).reshape(-1, 3), "map" if map else "geometry")


@dataclass(frozen=True, eq=False)
class _Body:
    """A robot at rest."""

    robot: Robot
    turns: FloatArray
    places: FloatArray

    def index(self, name: str) -> int:
        if name not in self.robot.links:
            some = ", ".join(self.robot.links[:12])
            raise MuybridgeError(
                f"{self.robot.path}: there is no link {name!r}; its links are {some}", remedy="role_map"
            )
        return self.robot.links.index(name)

    def path(self, link: int) -> list[int]:
        """From the root down to a link."""
        out = []
        while link >= 0:
            out.append(link)
            link = self.robot.parents[link]
        return out[::-1]

    def joints(self, link: int) -> list[Joint]:
        return [joint for joint in self.robot.joints if joint.link == link]

    def axis(self, joint: Joint) -> FloatArray:
        return np.asarray(self.turns[joint.link] @ joint.axis)

    def anchor(self, link: int) -> FloatArray:
        """(3,) metres of the joint that moves a link."""
        mine = self.joints(link)
        return np.asarray(self.places[link] + self.turns[link] @ (mine[0].anchor if mine else np.zeros(3)))

    def height(self) -> float:
        """Metres, without links above the body that are only frames, such as one on the floor below the robot."""
        robot, first = self.robot, 0
        solid = {shape.link for shape in robot.shapes} | set(np.flatnonzero(robot.masses > 0).tolist())
        while first not in solid and robot.parents.count(first) == 1 and not self.joints(first + 1):
            first += 1
        return float(max(np.ptp(self.places[first:, 2]), 1e-6))

    def tip(self, link: int) -> FloatArray:
        """(3,) metres where a link without links that move below it ends."""
        robot, start = self.robot, self.anchor(link)
        ends = [self.places[link] + self.turns[link] @ end for end in bone_ends(robot, link)]
        if np.isfinite(robot.centres[link]).all():
            ends.append(2 * (self.places[link] + self.turns[link] @ robot.centres[link]) - start)
        ends += [self.places[link] + self.turns[link] @ s.place for s in robot.shapes if s.link == link]
        return max(ends, key=lambda end: float(np.linalg.norm(end - start))) if ends else start

    def limb(self, chain: tuple[int, ...], middle: int | None = None) -> Limb:
        """The limb of links that joints move."""
        robot, anchors = self.robot, [self.anchor(k) for k in chain]
        tip = self.tip(chain[-1])
        middle = self._middle(chain, anchors, tip) if middle is None else middle
        knee = anchors[chain.index(middle)]
        after = chain[chain.index(middle) + 1 :]
        bends = [k for k in after if any(abs(self.axis(j) @ _unit(tip - knee)) < _TWIST for j in self.joints(k))]
        end = np.mean([self.anchor(k) for k in bends[:2]], axis=0) if bends else tip
        start = self._centre(chain[: chain.index(middle)] or chain[:1])
        return Limb(chain, robot.parents[chain[0]], middle, chain[-1], np.stack([start, knee, end, tip]), bool(bends))

    def _middle(self, chain: tuple[int, ...], anchors: list[FloatArray], tip: FloatArray) -> int:
        """The link below the joint that bends the limb nearest to its middle."""
        best, found = -1.0, chain[len(chain) // 2]
        for k in range(1, len(chain)):
            upper, lower = anchors[k] - anchors[0], tip - anchors[k]
            axes = [self.axis(joint) for joint in self.joints(chain[k])]
            twists = all(max(abs(axis @ _unit(lower)), abs(axis @ _unit(upper))) > _TWIST for axis in axes)
            score = min(float(np.linalg.norm(upper)), float(np.linalg.norm(lower)))
            if axes and not twists and score > best:
                best, found = score, chain[k]
        return found

    def _centre(self, links: tuple[int, ...]) -> FloatArray:
        """(3,) metres: the point nearest to the axes of the joints of a hip or shoulder."""
        lines = [(self.axis(j), self.places[k] + self.turns[k] @ j.anchor) for k in links for j in self.joints(k)]
        first = lines[0][1]
        matrix, right = np.eye(3) * 1e-2, first * 1e-2
        for axis, point in lines:
            across = np.eye(3) - np.outer(axis, axis)
            matrix += across
            right = right + across @ point
        return np.asarray(np.linalg.solve(matrix, right))

    def head(self, chest: int, limbs: Mapping[str, Limb]) -> int:
        """The last link that joints move over the shoulders, on no limb; -1 for none."""
        taken = {k for limb in limbs.values() for k in limb.links}
        shoulders = np.mean([limbs[f"{s}_arm"].points[0] for s in SIDES], axis=0)
        out, highest = -1, float(shoulders[2])
        for link in range(len(self.robot)):
            path = self.path(link)
            if self.joints(link) and chest in path and link != chest and not taken & set(path):
                place = max(float(self.anchor(link)[2]), float(self.tip(link)[2]))
                if place >= highest:
                    out, highest = link, place
        return out


def _unit(vector: FloatArray) -> FloatArray:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12))


def _chains(body: _Body) -> list[tuple[int, ...]]:
    """Runs of moved links without branches, each down to an end; fingers and toes are cut off."""
    robot = body.robot
    moved = {joint.link for joint in robot.joints}
    above: dict[int, int] = {}
    for link in sorted(moved):
        parent = robot.parents[link]
        while parent > 0 and parent not in moved:
            parent = robot.parents[parent]
        above[link] = parent
    below: dict[int, list[int]] = {}
    for link, parent in above.items():
        below.setdefault(parent, []).append(link)

    def reach(link: int, start: FloatArray) -> float:
        return max([float(np.linalg.norm(body.anchor(link) - start)), *(reach(k, start) for k in below.get(link, []))])

    size = _HAND * body.height()
    hands = {
        k for k, ends in below.items() if k > 0 and len(ends) > 1 and all(reach(e, body.anchor(k)) < size for e in ends)
    }
    out = []
    for link in moved:
        if (link in hands or link not in below) and not hands & set(body.path(link)[:-1]):
            chain = [link]
            while (parent := above[chain[0]]) > 0 and len(below[parent]) == 1:
                chain.insert(0, parent)
            out.append(tuple(chain))
    return out


def _of_geometry(body: _Body) -> dict[str, tuple[tuple[int, ...], int | None]]:
    chains = [chain for chain in _chains(body) if len(chain) >= _LEAST_JOINTS]
    height = body.height()
    pairs = []
    for i, one in enumerate(chains):
        for other in chains[:i]:
            same_base = body.robot.parents[one[0]] == body.robot.parents[other[0]]
            a, b = (np.array([body.anchor(k) for k in chain]) for chain in (one, other))
            if len(one) != len(other):
                continue
            uneven = float(np.abs(a[:, 2] - b[:, 2]).max()) / height
            apart = float(np.linalg.norm((a[0] - b[0])[:2]))
            if uneven < 0.05 and apart > 0.02 * height and same_base:
                pairs.append((one, other))
    if len(pairs) < 2:
        raise MuybridgeError(
            f"{body.robot.path}: the robot has no two legs and two arms that could be recognised", remedy="role_map"
        )
    legs = min(pairs, key=lambda pair: float(np.mean([body.anchor(chain[-1])[2] for chain in pair])))
    rest = [pair for pair in pairs if not set(pair[0] + pair[1]) & set(legs[0] + legs[1])]
    if not rest:
        raise MuybridgeError(f"{body.robot.path}: the robot has legs, but no two arms", remedy="role_map")
    arms = max(rest, key=lambda pair: float(np.mean([body.anchor(chain[0])[2] for chain in pair])))
    low = [float(np.mean([body.anchor(chain[-1])[2] for chain in pair])) for pair in (legs, arms)]
    high = [float(np.mean([body.anchor(chain[0])[2] for chain in pair])) for pair in (legs, arms)]
    if abs(low[0] - low[1]) < _LEVEL * height and abs(high[0] - high[1]) < _LEVEL * height:
        raise MuybridgeError(f"{body.robot.path}: the robot stands on four legs", remedy="role_map")
    names = ("left_leg", "right_leg", "left_arm", "right_arm")
    return {name: (chain, None) for name, chain in zip(names, (*legs, *arms), strict=True)}


def _of_map(body: _Body, map: Mapping[str, str]) -> dict[str, tuple[tuple[int, ...], int | None]]:
    moved = {joint.link for joint in body.robot.joints}
    out: dict[str, tuple[tuple[int, ...], int | None]] = {}
    for side in SIDES:
        for kind, parts in _PARTS.items():
            roles = [f"{side}_{part}" for part in parts]
            needed = roles if kind == "leg" else roles[:2]
            if missing := [role for role in needed if role not in map]:
                raise MuybridgeError(f"{body.robot.path}: the map names no link for {missing[0]}", remedy="role_map")
            start, middle, end = (body.index(map.get(role, map[roles[1]])) for role in roles)
            path = body.path(end)
            if start not in path or middle not in path or path.index(middle) <= path.index(start):
                raise MuybridgeError(
                    f"{body.robot.path}: {map[roles[1]]!r} is not between {map[roles[0]]!r} and "
                    f"{body.robot.links[end]!r}",
                    remedy="role_map",
                )
            chain = tuple(k for k in path[path.index(start) :] if k in moved)
            if middle not in chain or start not in chain:
                raise MuybridgeError(f"{body.robot.path}: no joint moves {map[roles[0]]!r} or {map[roles[1]]!r}",
                                     remedy="role_map")  # fmt: skip
            out[f"{side}_{kind}"] = (chain, middle)
    return out


def _axes(body: _Body, limbs: Mapping[str, Limb]) -> FloatArray:
    """(3, 3) left, back and up: knees bend backwards, elbows forwards, feet point ahead; X is ahead where none tell."""
    across = limbs["left_leg"].points[0] - limbs["right_leg"].points[0]
    across = _unit(across * [1, 1, 0])
    ahead = np.cross(across, _UP)
    evidence = 0.2 * float(ahead[0])
    for name, limb in limbs.items():
        leg = name.endswith("leg")
        size = float(np.linalg.norm(np.diff(limb.points[:3], axis=0), axis=1).sum())
        evidence += (-1.0 if leg else 0.3) * np.tanh(4 * float(_bend(body, limb) @ ahead) / size)
        if leg:
            evidence += np.tanh(10 * float((limb.points[3] - limb.points[2]) @ ahead) / size)
    ahead = ahead * (1.0 if evidence >= 0 else -1.0)
    return np.stack([np.cross(_UP, ahead), -ahead, _UP], axis=1)


def _bend(body: _Body, limb: Limb) -> FloatArray:
    """(3,) metres that the end moves when knee or elbow go to the middle of their range."""
    joint = body.joints(limb.middle)[-1]
    if not np.isfinite([joint.lower, joint.upper]).all():
        return np.zeros(3)
    middle = (joint.lower + joint.upper) / 2 - joint.rest
    arm, axis = limb.points[2] - limb.points[1], body.axis(joint)
    return np.asarray(np.cross(axis, arm) * np.sin(middle))


def _sides_of_arms(limbs: dict[str, Limb], axes: FloatArray) -> dict[str, Limb]:
    """The arms' sides by where they are."""
    gap = limbs["left_arm"].points[0] - limbs["right_arm"].points[0]
    if float(gap @ axes[:, 0]) < 0:
        limbs = limbs | {"left_arm": limbs["right_arm"], "right_arm": limbs["left_arm"]}
    return limbs
