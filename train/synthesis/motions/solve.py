"""From a script (joint angles, foot plans, flights) to rotations: contacts, balance, ballistics, the floor."""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from muybridge.arrays import FloatArray
from muybridge.geometry.ik.two_bone import solve_two_bone
from muybridge.geometry.skeleton.mass import centre_of_mass
from muybridge.train.synthesis.motions.ground_contact import chosen_skin, flat_hand, sink_limbs
from muybridge.train.synthesis.motions.rig import (
    NECK,
    SIDES,
    SPINE,
    SkinnedBody,
    apply,
    arm_rest,
    between,
    forward,
    log,
    rot,
    skin,
    turn,
    unit,
)
from muybridge.train.synthesis.motions.script import GRAVITY, SETTLING, Script, limit

TOES = 62.0  # degrees, how far toes bend up
THUMB = 35.0  # degrees, how far a thumb is spread beside a hand on the floor
STRIDE = 4  # corrections are slow: they are computed on every fourth frame


class Solver:
    """Turns scripts into motion of one skeleton."""

    def __init__(self, skeleton: SkinnedBody) -> None:
        self.k = skeleton
        self.i = {b: n for n, b in enumerate(skeleton.bones)}
        toes = [b for b in skeleton.bones if b.startswith("toe") and b.endswith("-1.L")]
        ball = np.mean([skeleton.at(b) for b in toes], 0)
        self.toes = {s: [self.i[b[:-1] + s] for b in toes] for s, _ in SIDES}
        ankle = skeleton.at("foot.L")
        self.ball_offset = ball - ankle  # of the left foot; mirrored for the right
        self.ball_height = float(ball[2])
        self.heel = np.array([0.0, 0.25 * (ankle[2] + 0.08), -ankle[2]])  # from the ankle
        self.ankle_heights = self._ankle_heights()
        self.palm = {s: flat_hand(skeleton, s) for s, _ in SIDES}

    def _ankle_heights(self) -> tuple[FloatArray, FloatArray]:
        """Pitches of a foot in degrees and how high its ankle is while the lowest point of the foot is on the floor,
        the toes lying flat."""
        k, pitch = self.k, np.linspace(-40, 95, 55)
        local = np.broadcast_to(np.eye(3), (len(pitch), len(k.bones), 3, 3)).copy()
        local[:, self.i["foot.L"]] = rot(0, pitch)
        for toe in self.toes["L"]:
            local[:, toe] = rot(0, -pitch.clip(0, TOES))
        moved = {self.i["foot.L"]} | {i for i, b in enumerate(k.bones) if b.startswith("toe") and b.endswith(".L")}
        mine = np.isin(k.strongest, list(moved))
        rotations, origins = forward(k, local, np.broadcast_to(k.rest[0], (len(pitch), 3)))
        low = skin(k, rotations, origins, mine)[..., 2].min(1)
        return pitch, gaussian_filter1d(k.at("foot.L")[2] - low, 1.0, mode="nearest")

    def ball_at_rest(self, side: str) -> FloatArray:
        """(3,) the ball of the foot at rest."""
        return np.asarray(self.k.at("foot." + side) + self.ball_offset * ([1, 1, 1] if side == "L" else [-1, 1, 1]))

    def solve(self, script: Script) -> tuple[FloatArray, FloatArray]:
        """Local rotations (T, bones, 3, 3) and root positions (T, 3)."""
        slow = script.every(STRIDE)
        shift = np.zeros((len(slow.time), 3))
        for _ in range(6):
            local, root = self.pose(slow, shift)
            _, at = forward(self.k, local, root)
            shift = shift + self._corrections(slow, local, root, at)
        if len(slow.time) > 3:
            shift = gaussian_filter1d(shift, 1.2, axis=0, mode="nearest")
            shift = CubicSpline(slow.time, shift)(script.time)
            shift[script.time > slow.time[-1]] = shift[script.time <= slow.time[-1]][-1]
        else:
            shift = np.repeat(shift, STRIDE, 0)[: len(script.time)]
        local, root = self.pose(script, shift)
        if script["ground"].any():
            lowered = self._onto_the_floor(script, local, root)
            root = root + lowered
            if script.bearing:
                local, root = self.pose(script, shift + lowered)
            local = self._limbs_onto_the_floor(script, local, root)
            root = root + self._out_of_the_floor(script, local, root)
        if script.flights:
            root = root + self._ballistics(script, local, root)
        return local, root

    def _corrections(self, script: Script, local: FloatArray, root: FloatArray, at: FloatArray) -> FloatArray:
        """How far the root should move for balance and for the floor."""
        out = np.zeros_like(root)
        if script["balance"].any():
            foot = np.stack([0.5 * at[:, self.i["foot." + s], :2] + 0.5 * at[:, self.toes[s], :2].mean(1)
                             for s, _ in SIDES])  # fmt: skip
            load = self._load(script)
            support = (load[..., None] * foot).sum(0)
            error = support - centre_of_mass(at, self.k.roles)[:, :2]
            out[:, :2] = script["balance"][:, None] * error
        low = self._lowest(local, root, script.bearing)
        out[:, 2] = -low * script["ground"] + (1 - script["ground"]) * np.maximum(-low - 0.004, 0) * 0.7
        return out

    def _onto_the_floor(self, script: Script, local: FloatArray, root: FloatArray) -> FloatArray:
        """Shift of the root that puts the lowest point on the floor where `ground` is 1, and nowhere below it."""
        low = self._lowest(local, root, script.bearing)
        out = np.zeros_like(root)
        low = np.where(low < 0, low, low * (1 - (1 - script["ground"]) ** 3))
        out[:, 2] = -gaussian_filter1d(low, script.settling / script.step, mode="nearest")
        return out

    def _lowest(self, local: FloatArray, root: FloatArray, bearing: tuple[str, ...] = ()) -> FloatArray:
        """(T,) height of the lowest point of the skin, or of what bears the body."""
        rotations, at = forward(self.k, local, root)
        mine = chosen_skin(self.k, bearing) if bearing else slice(None)
        return np.asarray(skin(self.k, rotations, at, mine)[..., 2].min(1))

    def _limbs_onto_the_floor(self, script: Script, local: FloatArray, root: FloatArray) -> FloatArray:
        """Local rotations with limbs and head out of the floor, and sunk onto it as far as the script wants."""
        c = script.channels
        near = np.clip(2 * c["ground"], 0, 1)
        sink, free = {"head": c["headsink"] * c["ground"]}, {"head": near}
        for s, _ in SIDES:
            kneels = c["kneel" + s]
            sink |= {name + s: c[f"{name}sink{s}"] * c["ground"] for name in ("arm", "leg")}
            sink["shank" + s] = c["ground"] * kneels
            free["arm" + s] = near * (1 - c["hand" + s])
            free["leg" + s] = near * (1 - c["plant" + s]) * (1 - kneels)
            free["shank" + s] = near * kneels
        return sink_limbs(self.k, local, root, script.step, sink, free)

    def _out_of_the_floor(self, script: Script, local: FloatArray, root: FloatArray) -> FloatArray:
        """Shift of the root for what is still in the floor."""
        out, low = np.zeros_like(root), self._lowest(local, root)
        out[:, 2] = gaussian_filter1d(np.maximum(-low, 0), SETTLING / script.step, mode="nearest")
        return out

    def _load(self, script: Script) -> FloatArray:
        """(2, T) share of the weight on each foot: it leaves a foot before the foot leaves the floor."""
        loads = []
        for s, _ in SIDES:
            off = np.nonzero(script["contact" + s] < 0.5)[0]
            away = np.full(len(script.time), 1.0)
            if len(off):
                away = np.abs(np.arange(len(script.time))[:, None] - off).min(1) * script.step / 0.45
            x = np.clip(away, 0, 1)
            loads.append(x**3 * (10 - 15 * x + 6 * x**2) + 1e-4)
        both = np.stack(loads)
        return np.asarray(both / both.sum(0))

    def _ballistics(self, script: Script, local: FloatArray, root: FloatArray) -> FloatArray:
        """Shift of the root that makes every flight of the centre of mass a parabola through its ends."""
        _, at = forward(self.k, local, root)
        com, out = centre_of_mass(at, self.k.roles), np.zeros_like(root)
        for a, b in script.flights:
            t, span = script.time[a : b + 1] - script.time[a], script.time[b] - script.time[a]
            line = com[a] + (com[b] - com[a]) * (t / span)[:, None]
            line[:, 2] += 0.5 * GRAVITY * t * (span - t)
            out[a : b + 1] = line - com[a : b + 1]
        return out

    def pose(self, script: Script, shift: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Local rotations and root positions, the root moved by `shift`."""
        c, n = script.channels, len(script.time)
        local = np.broadcast_to(np.eye(3), (n, len(self.k.bones), 3, 3)).copy()
        local[:, 0] = rot(2, c["yaw"]) @ rot(1, c["roll"]) @ rot(0, c["pitch"])
        lean, lateral, twist = limit(c["lean"], -38, 78), limit(c["lateral"], -38, 38), limit(c["twist"], -55, 55)
        bend = turn(np.radians(np.stack([lean, lateral, twist], -1)) / len(SPINE))
        for bone in SPINE:
            local[:, self.i[bone]] = bend
        nod, tilt, look = limit(c["nod"], -60, 55), limit(c["tilt"], -35, 35), limit(c["look"], -75, 75)
        head = np.radians(np.stack([nod, tilt, look], -1))
        for bone, share in NECK:
            local[:, self.i[bone]] = turn(head * share)
        root = np.stack([c["x"], c["y"], c["height"] * self.k.rest[0, 2]], -1) + shift
        root[:, 2] = self._within_reach(script, local[:, 0], root)
        for side, sign in SIDES:
            self._leg_within_limits(script, local, root, side, sign)
            self._arm(script, local, root, side, sign)
        return local, root

    def _within_reach(self, script: Script, pelvis: FloatArray, root: FloatArray) -> FloatArray:
        """Heights of the root, lowered where a foot on the floor could not be reached."""
        height = root[:, 2].copy()
        for side, sign in SIDES:
            hip = root + pelvis @ (self.k.at("upperleg01." + side) - self.k.rest[0])
            ankle, _ = self._foot_target(script, side, sign)
            span = self.k.at("upperleg01." + side) - self.k.at("foot." + side)
            most = float(np.linalg.norm(span)) * 0.997
            flat = ((hip - ankle)[:, :2] ** 2).sum(1)
            top = ankle[:, 2] + np.sqrt(np.maximum(most**2 - flat, 1e-3)) - hip[:, 2] + root[:, 2]
            on = gaussian_filter1d(script["contact" + side], 0.05 / script.step, mode="nearest")
            excess = height - top
            excess = 0.5 * (excess + np.sqrt(excess**2 + 0.01**2))
            height = height - excess * np.clip(on * 2, 0, 1) ** 2 * (script["plant" + side] > 0.5)
        return height

    def _foot_target(
        self, script: Script, side: str, sign: float, rise: FloatArray | float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Ankle positions and foot rotations of the plan, the heel `rise` degrees higher: the foot rolls over its
        ball, or over its heel."""
        c = script.channels
        pitch = c["bpitch" + side] + rise
        flip = np.array([sign, 1.0, 1.0])
        offset, heel = self.ball_offset * flip, self.heel * flip
        heading, roll = rot(2, c["byaw" + side]), rot(0, pitch)
        ball = np.stack([c["bx" + side], c["by" + side], c["bz" + side] + self.ball_height], -1)
        over_ball = apply(heading, apply(roll, np.broadcast_to(-offset, ball.shape)))
        over_heel = apply(heading, heel - offset - apply(roll, np.broadcast_to(heel, ball.shape)))
        ankle = ball + np.where(pitch[:, None] > 0, over_ball, over_heel)
        ankle[:, 2] = c["bz" + side] + np.interp(pitch, *self.ankle_heights)
        return ankle, heading @ roll

    def _leg_within_limits(self, script: Script, local: FloatArray, root: FloatArray, side: str, sign: float) -> None:
        """The leg; where its ankle would bend up too far, the heel leaves the floor."""
        rise = np.zeros(len(root))
        for _ in range(4):
            self._leg(script, local, root, side, sign, rise)
            foot = local[:, self.i["foot." + side]]
            excess = (-np.degrees(np.arctan2(foot[:, 2, 1], foot[:, 1, 1])) - 34).clip(0)
            if excess.max() < 1:
                break
            rise = rise + excess**2 / (excess + 4) * script["plant" + side]

    def _leg(
        self, script: Script, local: FloatArray, root: FloatArray, side: str, sign: float, rise: FloatArray
    ) -> None:
        c, k = script.channels, self.k
        hip, knee, foot = k.at("upperleg01." + side), k.at("lowerleg01." + side), k.at("foot." + side)
        upper, lower, hinge, pelvis = knee - hip, foot - knee, np.array([1.0, 0, 0]), local[:, 0]
        thigh = rot(1, -sign * limit(c["abd" + side], -28, 70)) @ rot(0, -limit(c["hip" + side], -35, 130))
        thigh = thigh @ rot(2, sign * limit(c["hiprot" + side], -40, 50))
        bend = limit(c["knee" + side], -6, 150)
        free = apply(thigh, upper + apply(rot(0, bend), np.broadcast_to(lower, root.shape)))
        free_foot = pelvis @ thigh @ rot(0, bend) @ rot(0, limit(c["ankle" + side], -28, 55))
        weight = c["plant" + side][:, None]
        target, planted_foot = self._foot_target(script, side, sign, rise)
        back = np.swapaxes(pelvis, -1, -2)
        turned = np.swapaxes(free_foot, -1, -2) @ planted_foot
        foot_rotation = free_foot @ turn(log(turned) * weight)
        place = root + apply(pelvis, free + (hip - k.rest[0]))
        place = target * weight + place * (1 - weight)
        place[:, 2] += (1 - weight[:, 0]) * (1 - c["ground"]) * self._clearance(foot_rotation, place[:, 2])
        wanted = apply(back, place - root) - (hip - k.rest[0])
        outward = apply(back, planted_foot[..., 0] * 1.0)
        pole = weight * outward + (1 - weight) * thigh[..., 0]
        pole = pole + 0.6 * weight * thigh[..., 0]
        thigh, bend = solve_two_bone(upper, lower, hinge, wanted, pole, (-6.0, 154.0))
        shank = pelvis @ thigh @ rot(0, bend)
        local[:, self.i["upperleg01." + side]] = thigh
        local[:, self.i["lowerleg01." + side]] = rot(0, bend)
        local[:, self.i["foot." + side]] = np.swapaxes(shank, -1, -2) @ foot_rotation
        on_floor = c["plant" + side] * np.exp(-c["bz" + side].clip(0) / 0.03)
        flat = rot(0, -(c["bpitch" + side] + rise).clip(0, TOES) * on_floor)
        for toe in self.toes[side]:
            local[:, toe] = flat

    def _clearance(self, foot: FloatArray, height: FloatArray) -> FloatArray:
        """How much a free foot with these rotations must rise so as not to touch the floor, its ankle at `height`."""
        toe_down = foot[:, 2, 1].clip(-1, 1)
        least = np.interp(np.degrees(np.arcsin(toe_down)), *self.ankle_heights) + 0.07 * toe_down.clip(0)
        least = least + 0.05 * np.abs(foot[:, 2, 0]) + 0.005
        return np.asarray(0.5 * (least - height + np.sqrt((least - height) ** 2 + 0.015**2)))

    def _arm(self, script: Script, local: FloatArray, root: FloatArray, side: str, sign: float) -> None:
        c, k = script.channels, self.k
        flex, out = np.radians(limit(c["flex" + side], -65, 178)), np.radians(limit(c["out" + side], -35, 165))
        hinge, rest, bent = arm_rest(k, side)
        aim = np.stack([sign * np.sin(out), -np.sin(flex) * np.cos(out), -np.cos(flex) * np.cos(out)], -1)
        raised = between(np.broadcast_to(rest, aim.shape), aim)
        local[:, self.i["clavicle." + side]] = turn(raised * 0.12)
        local[:, self.i["shoulder01." + side]] = turn(raised * 0.10)
        spin = turn(np.radians(limit(c["armtwist" + side], -80, 80))[:, None] * rest * -sign)
        arm, elbow = turn(raised * 0.78) @ spin, limit(c["elbow" + side], 5, 150) - bent
        if c["hand" + side].any():
            arm, elbow = self._hand(script, local, root, side, arm, elbow)
        local[:, self.i["upperarm01." + side]] = arm
        local[:, self.i["lowerarm01." + side]] = turn(np.radians(elbow)[:, None] * hinge)
        lower = unit(k.at("wrist." + side) - k.at("lowerarm01." + side)) * sign
        local[:, self.i["lowerarm02." + side]] = turn(np.radians(limit(c["pro" + side], -75, 75))[:, None] * lower)
        local[:, self.i["wrist." + side]] = rot(1, sign * limit(c["wrist" + side], -75, 70))
        if c["palm" + side].any():
            self._flatten_hand(script, local, root, side, sign)
        for finger in range(2, 6):
            for joint in range(1, 4):
                local[:, self.i[f"finger{finger}-{joint}.{side}"]] = rot(1, sign * limit(c["curl" + side], -5, 90))

    def _flatten_hand(self, script: Script, local: FloatArray, root: FloatArray, side: str, sign: float) -> None:
        """The hand flat on the floor and its thumb beside it, mixed in by `palm`."""
        weight, palm = script["palm" + side][:, None], self.palm[side][0]
        above = self._carried(local, root, "lowerarm02." + side)[0]
        lain = np.swapaxes(above, -1, -2) @ rot(2, script["yaw"]) @ palm
        bent = local[:, self.i["wrist." + side]]
        local[:, self.i["wrist." + side]] = bent @ turn(log(np.swapaxes(bent, -1, -2) @ lain) * weight)
        local[:, self.i["finger1-1." + side]] = turn(weight * np.radians(THUMB) * (palm.T @ [0.0, sign, 0.0]))

    def _hand(self, script: Script, local: FloatArray, root: FloatArray, side: str, arm: FloatArray,
              elbow: FloatArray) -> tuple[FloatArray, FloatArray]:  # fmt: skip
        """The upper arm and elbow that bring the wrist to its place, mixed in by `hand`."""
        c, k, hold = script.channels, self.k, script.holds.get(side)
        rotation, origin = self._carried(local, root, "shoulder01." + side)
        origin = origin + rotation @ (k.at("upperarm01." + side) - k.at("shoulder01." + side))
        shoulder, joint, wrist = (k.at(b + side) for b in ("upperarm01.", "lowerarm01.", "wrist."))
        hinge, _, bent = arm_rest(k, side)
        upper, lower = joint - shoulder, wrist - joint
        place = np.stack([c["hx" + side], c["hy" + side], c["hz" + side]], -1)
        if hold:
            turned, at = self._carried(local, root, hold.bone)
            place = at + apply(turned, place - k.at(hold.bone))
        into = np.swapaxes(rotation, -1, -2)
        place = apply(into, place - origin)
        bend = turn(np.radians(elbow)[:, None] * hinge)
        free = apply(arm, upper + apply(bend, np.broadcast_to(lower, place.shape)))
        weight = c["hand" + side][:, None]
        place = place * weight + free * (1 - weight)
        pole = apply(arm, np.broadcast_to(hinge, place.shape))
        if hold:
            elbow_out = apply(into @ self._carried(local, root, SPINE[-1])[0], np.broadcast_to(hold.elbow, place.shape))
            pole = unit(pole) * (1 - weight) + unit(np.cross(elbow_out, place)) * weight
        return solve_two_bone(upper, lower, hinge, place, pole, (5 - bent, 150 - bent))

    def _carried(self, local: FloatArray, root: FloatArray, bone: str) -> tuple[FloatArray, FloatArray]:
        """Rotation (T, 3, 3) and origin (T, 3) of a bone in the world, of those before it in `local`."""
        chain = [self.i[bone]]
        while (above := int(self.k.parents[chain[0]])) >= 0:
            chain.insert(0, above)
        rotation, origin = local[:, chain[0]], root
        for last, i in zip(chain[:-1], chain[1:], strict=True):
            origin = origin + rotation @ (self.k.rest[i] - self.k.rest[last])
            rotation = rotation @ local[:, i]
        return rotation, origin
