"""Seeded, procedural motion as sequences: wide and plausible, within joint limits, on the floor or in flight.

A clip comes from a generator (`standing`, `floor`, `acrobatics`) that writes a script of joint angles and foot plans;
`solve` makes it stand on its feet, keep its balance and fly in parabolas. A clip that
breaks a bar (joint limits, sliding feet, self-penetration, speed) is drawn again, calmer.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.motion.contacts.footskate import sliding_frames
from muybridge.train.synthesis.motions import acrobatics, floor, standing
from muybridge.train.synthesis.motions.hands import hands_at_rest
from muybridge.train.synthesis.motions.rig import LIMITS, SIDES, SkinnedBody, forward, joint_angles, log, rot, turn
from muybridge.train.synthesis.motions.script import Script
from muybridge.train.synthesis.motions.self_collision import penetrates
from muybridge.train.synthesis.motions.solve import Solver
from muybridge.train.synthesis.motions.stage import Stage

# Kinds of motion with their shares.
MOTIONS: dict[str, float] = {
    "stand": 0.20, "walk": 0.14, "run": 0.07, "jump": 0.07, "squat": 0.07, "kneel": 0.05, "sit": 0.07, "reach": 0.08,
    "throw": 0.05, "kick": 0.06, "balance": 0.08, "dance": 0.08, "crawl": 0.02, "lie": 0.02, "get_up": 0.02,
    "floor_sit": 0.015, "plank": 0.01, "handstand": 0.01, "cartwheel": 0.01, "somersault": 0.005,
}  # fmt: skip
# Share of the clips of a kind in which hands rest somewhere (`hands`).
HANDS_AT_REST = {"stand": 0.65, "walk": 0.3, "sit": 0.55, "kneel": 0.2}
TRIES = 7
FASTEST = 2200.0  # degrees per second, any joint


@dataclass(frozen=True)
class MotionClip:
    """A motion of one skeleton.

    Attributes:
        rotvec: (T, bones, 3) rotation vectors, radians, `local-ref`.
        root: (T, 3) metres, origin of the root bone in the world (z up, floor z = 0).
        fps: frames per second.
        kind: name of the motion.
        contacts: (T, 2) whether the left and right foot stand on the floor; a standing foot's ball does not move.
        flights: spans (first, last) of frames between which nothing is touched.
    """

    rotvec: FloatArray
    root: FloatArray
    fps: float
    kind: str
    contacts: BoolArray
    flights: tuple[tuple[int, int], ...] = ()

    def velocity(self, frame: int) -> FloatArray:
        """(bones, 3) rates of the rotation vectors, radians per second, by central difference."""
        a, b = max(frame - 1, 0), min(frame + 1, len(self.root) - 1)
        return np.asarray((self.rotvec[b] - self.rotvec[a]) * self.fps / max(b - a, 1))


@dataclass(frozen=True)
class PoseSamples:
    """Single frames of clips.

    Attributes:
        rotvec: (N, bones, 3) radians, `local-ref`; velocity: (N, bones, 3) radians per second.
        kinds: (N,) index into `MOTIONS`.
    """

    rotvec: FloatArray
    velocity: FloatArray
    kinds: IndexArray


class MotionSampler:
    """Draws motion for one skeleton; the same generator state gives the same clips."""

    def __init__(self, skeleton: SkinnedBody, rng: np.random.Generator) -> None:
        self.skeleton, self.rng, self.solver = skeleton, rng, Solver(skeleton)
        self.mirror = [skeleton.bones.index(_other(b)) for b in skeleton.bones]

    def sample(self, seconds: float, fps: float, kind: str | None = None) -> MotionClip:
        """A clip of `round(seconds * fps)` frames; `kind` is a name of `MOTIONS`, drawn by share if absent.

        Raises:
            ValueError: an unknown kind, or fewer than 8 frames.
        """
        count = round(seconds * fps)
        if count < 8:
            raise ValueError(f"a clip of {count} frames is too short for motion: ask for at least 8")
        if kind is None:
            kind = str(self.rng.choice(list(MOTIONS), p=np.array(list(MOTIONS.values())) / sum(MOTIONS.values())))
        generator = _generator(kind)
        return self._place(self._best(kind, np.arange(count) / fps, fps, generator))

    def sample_pair(self, seconds: float, fps: float) -> tuple[MotionClip, MotionClip]:
        """Two people close together in one world: hand in hand, hands on hands, or talking, before or beside one
        another. Where they run into one another they are drawn again, farther apart."""
        time = np.arange(round(seconds * fps)) / fps
        gap = float(self.rng.uniform(0.55, 0.9))
        for attempt in range(TRIES):
            one, two = self._pair(time, fps, gap + 0.07 * attempt)
            if not self._collide(one, two):
                break
        heading, at = float(self.rng.uniform(-180, 180)), np.append(self.rng.uniform(-1, 1, 2), 0)
        return _turned(one, heading, at), _turned(two, heading, at)

    def _pair(self, time: FloatArray, fps: float, gap: float) -> tuple[MotionClip, MotionClip]:
        rng = self.rng
        high, k = 0.72 * self.skeleton.height, 2 * np.pi * time
        meet = np.stack([0.04 + 0.05 * np.sin(k * rng.uniform(0.2, 0.6)), np.full(len(time), -gap / 2 + 0.03),
                         high * rng.uniform(0.8, 1.05) + 0.06 * np.sin(k * rng.uniform(0.3, 1.2))], -1)  # fmt: skip
        style = int(rng.integers(3))
        hands = ((0.0, 1.0), (1.0, 1.0), (0.0, 0.0))[style]
        meet[:, 0] += 0.12 * (style == 1)
        clips = []
        for person in range(2):
            # The other's right hand meets at the same place, which lies to its left when it faces us.
            place = meet if person == 0 else meet + [-2 * float(meet[0, 0]) * (style == 0), 0, 0]
            act = functools.partial(floor.partner, meet=place, hands=hands, gap=gap)
            clips.append(self._best("pair", time, fps, act))
        if style < 2:
            return clips[0], _turned(clips[1], 180.0, np.array([0.0, -gap, 0.0]))
        facing, moved = float(rng.choice([0, 90, 180, -90])), np.array([gap + 0.05, rng.uniform(-0.2, 0.2), 0.0])
        return clips[0], _turned(clips[1], facing, moved)

    def _collide(self, one: MotionClip, two: MotionClip) -> bool:
        """Whether heads and trunks come within 0.3 m of one another, or a wrist within 0.13 m of the other's."""
        some = slice(None, None, max(1, round(one.fps / 10)))
        at = [forward(self.skeleton, turn(c.rotvec[some]), c.root[some])[1] for c in (one, two)]
        core = [a[:, [self.skeleton.index(b) for b in ("root", "spine03", "spine01", "neck01", "head")]] for a in at]
        wrists = [a[:, [self.skeleton.index("wrist." + s) for s, _ in SIDES]] for a in at]

        def nearest(a: FloatArray, b: FloatArray) -> float:
            return float(np.linalg.norm(a[:, :, None] - b[:, None], axis=-1).min())

        return nearest(*core) < 0.3 or nearest(wrists[0], core[1]) < 0.15 or nearest(wrists[1], core[0]) < 0.15

    def sample_poses(self, n: int, kinds: Sequence[str] | None = None) -> PoseSamples:
        """`n` single frames, well apart: clips of 8 s at 15 frames per second, twelve frames from each."""
        names = [m for m in MOTIONS if kinds is None or m in kinds]
        share = np.array([MOTIONS[m] for m in names])
        rotvec: list[FloatArray] = []
        velocity: list[FloatArray] = []
        kind: list[int] = []
        while len(kind) < n:
            name = str(self.rng.choice(names, p=share / share.sum()))
            clip = self.sample(8.0, 15.0, name)
            take = min(12, n - len(kind))
            for f in (np.arange(take) * 10 + self.rng.integers(0, 10, take)).tolist():
                rotvec.append(clip.rotvec[f])
                velocity.append(clip.velocity(f))
                kind.append(list(MOTIONS).index(name))
        return PoseSamples(np.stack(rotvec), np.stack(velocity), np.array(kind))

    def _best(self, kind: str, time: FloatArray, fps: float, generator: Callable[[Stage], None]) -> MotionClip:
        best, least = None, np.inf
        for attempt in range(TRIES):
            stage = Stage(self.solver, time, self.rng, attempt / (TRIES - 1))
            generator(stage)
            if self.rng.random() < HANDS_AT_REST.get(kind, 0.0):
                hands_at_rest(stage, seated=kind == "sit")
            clip, faults = self._finish(kind, stage.s, fps)
            total = sum(faults.values())
            if total < least:
                best, least = clip, total
            if total == 0:
                break
        assert best is not None
        return best

    def _finish(self, kind: str, script: Script, fps: float) -> tuple[MotionClip, dict[str, float]]:
        local, root = self.solver.solve(script)
        contacts = np.stack([script["contact" + s] > 0.5 for s, _ in SIDES], -1)
        for a, b in script.flights:
            contacts[a + 1 : b] = False
        clip = MotionClip(log(local), root, fps, kind, contacts, tuple(script.flights))
        return clip, self.faults(clip, local)

    def faults(self, clip: MotionClip, local: FloatArray | None = None) -> dict[str, float]:
        """Share of the frames that break each bar: limits, slide (5 mm), penetration, speed."""
        local = turn(clip.rotvec) if local is None else local
        _, at = forward(self.skeleton, local, clip.root)
        out = {"limits": 0.0, "slide": 0.0, "penetration": 0.0, "speed": 0.0}
        beyond = np.zeros(len(local), bool)
        for name, angle in joint_angles(self.skeleton, local).items():
            low, high = LIMITS[name]
            beyond |= ((angle < low) | (angle > high)).any(1)
        out["limits"] = float(beyond.mean())
        for j, (side, _) in enumerate(SIDES):
            ball = at[:, self.solver.toes[side]].mean(1)
            out["slide"] += float(sliding_frames(ball, clip.contacts[:, j]).mean())
        some = slice(None, None, max(1, round(clip.fps / 12)))
        height = np.full(len(at[some]), self.skeleton.height)
        out["penetration"] = float(penetrates(self.skeleton.bones, at[some], height).mean())
        turned = log(np.swapaxes(local[:-1], -1, -2) @ local[1:])
        out["speed"] = float((np.degrees(np.linalg.norm(turned, axis=-1)) * clip.fps > FASTEST).any(1).mean())
        return out

    def _place(self, clip: MotionClip) -> MotionClip:
        """Half of the clips are mirrored; every clip gets a heading and a place."""
        if self.rng.random() < 0.5:
            clip = self.mirrored(clip)
        return _turned(clip, float(self.rng.uniform(-180, 180)), np.append(self.rng.uniform(-1, 1, 2), 0.0))

    def mirrored(self, clip: MotionClip) -> MotionClip:
        """The same motion with left and right exchanged."""
        rotvec = clip.rotvec[:, self.mirror] * [1, -1, -1]
        return replace(clip, rotvec=rotvec, root=clip.root * [-1, 1, 1], contacts=clip.contacts[:, ::-1])


def _generator(kind: str) -> Callable[[Stage], None]:
    if kind not in MOTIONS:
        raise ValueError(f"unknown kind of motion {kind!r}: choose one of {', '.join(MOTIONS)}")
    modules = (standing, floor, acrobatics)
    found: Callable[[Stage], None] = next(getattr(m, kind) for m in modules if hasattr(m, kind))
    return found


def _turned(clip: MotionClip, heading: float, at: FloatArray) -> MotionClip:
    r = rot(2, heading)
    rotvec = clip.rotvec.copy()
    rotvec[:, 0] = log(r @ turn(clip.rotvec[:, 0]))
    return replace(clip, rotvec=rotvec, root=clip.root @ r.T + at)


def _other(bone: str) -> str:
    return bone[:-1] + ("R" if bone[-1] == "L" else "L") if bone[-2:] in (".L", ".R") else bone
