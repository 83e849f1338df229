"""Scripts of motion: named curves that a motion is solved from."""

from dataclasses import dataclass, field, replace

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.motions.rig import SIDES

GRAVITY = 9.81
SETTLING = 0.012  # s, how smooth the last shift onto the floor is over time

# Channels of a script with their values at ease; a channel of a limb has an L and an R. Degrees and metres.
TRUNK = {"lean": 3.0, "lateral": 0.0, "twist": 0.0, "nod": 3.0, "tilt": 0.0, "look": 0.0, "yaw": 0.0, "pitch": 2.0,
         "roll": 0.0, "x": 0.0, "y": 0.0, "height": 0.985, "ground": 0.0, "balance": 0.0, "headsink": 0.0}  # fmt: skip
LIMB = {"hip": 5.0, "abd": -3.0, "hiprot": 4.0, "knee": 8.0, "ankle": 0.0, "plant": 1.0, "contact": 1.0,
        "bx": 0.0, "by": 0.0, "bz": 0.0, "byaw": 0.0, "bpitch": 0.0, "flex": 0.0, "out": 14.0, "elbow": 22.0,
        "armtwist": 0.0, "pro": 0.0, "wrist": 0.0, "curl": 25.0, "hand": 0.0, "hx": 0.0, "hy": 0.0,
        "hz": 0.0, "palm": 0.0, "armsink": 0.0, "legsink": 0.0, "kneel": 0.0}  # fmt: skip


@dataclass(frozen=True)
class Hold:
    """A hand that rests on the body, or keeps its place before it.

    Attributes:
        bone: which carries the place; `hx hy hz` are then coordinates of the body at rest, not of the world.
        elbow: (3,) where the elbow points, in the axes of the body at rest.
    """

    bone: str
    elbow: FloatArray


@dataclass
class Script:
    """A motion as it is wanted, before it is solved for a body.

    Attributes:
        time: (T,) seconds.
        channels: named curves (T,), see `TRUNK` and `LIMB`. `height` is the root's, as a share of its height when
            standing; `bx by bz byaw bpitch` where the ball of the foot is; `plant` how much the foot follows that
            rather than the leg's angles; `contact` 1 where it stands still on the floor; `hx hy hz` a place for the
            wrist and `hand` how much the arm follows it, `palm` how flat the hand lies on the floor; `ground` 1 where
            what bears the body lies on the floor, and the limbs stay out of it; `armsink legsink headsink` how far
            these sink onto it then; `kneel` 1 where it is a knee that bears, and the shank that sinks; `balance` 1
            where the centre of mass shall be over the feet.
        flights: spans (first, last) of frames without contact.
        holds: hands whose place the body carries, by side.
        bearing: beginnings of the names of the bones that bear the body where `ground` is 1; all if there are none.
        settling: s, over which the shift onto the floor is smoothed.
    """

    time: FloatArray
    channels: dict[str, FloatArray] = field(default_factory=dict)
    flights: list[tuple[int, int]] = field(default_factory=list)
    holds: dict[str, Hold] = field(default_factory=dict)
    bearing: tuple[str, ...] = ()
    settling: float = SETTLING

    def __post_init__(self) -> None:
        names = TRUNK | {k + s: v for k, v in LIMB.items() for s, _ in SIDES}
        for name, value in names.items():
            self.channels.setdefault(name, np.full(len(self.time), value))

    def __getitem__(self, name: str) -> FloatArray:
        return self.channels[name]

    def __setitem__(self, name: str, value: FloatArray | float) -> None:
        self.channels[name] = np.broadcast_to(np.asarray(value, np.float64), self.time.shape).copy()

    @property
    def step(self) -> float:
        """Seconds between frames; 1 where there is but one."""
        return float(self.time[1] - self.time[0]) if len(self.time) > 1 else 1.0

    def every(self, step: int) -> "Script":
        """Every `step`-th frame."""
        channels = {k: v[::step] for k, v in self.channels.items()}
        return replace(self, time=self.time[::step], channels=channels, flights=[])


def limit(value: FloatArray, low: float, high: float, soft: float = 8.0) -> FloatArray:
    """Smooth clamp: the identity inside, bending within `soft` of the limits, never beyond them."""
    above, below = np.maximum(value - (high - soft), 0), np.maximum(low + soft - value, 0)
    return np.asarray(np.clip(value, low + soft, high - soft) + soft * (np.tanh(above / soft) - np.tanh(below / soft)))
