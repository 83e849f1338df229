"""People and things that move: what is posed frame by frame, and how places and angles change over time."""

import copy
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator
from scipy.optimize import minimize_scalar

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.things.built import Built
from muybridge.train.synthesis.things.scene import Scene, Thing
from muybridge.train.synthesis.things.using.figure import Figure, posed

_AT_ONCE = 32  # bodies that are computed together
_BENDS = (-5.0, 75.0)  # least and most that a trunk bends, degrees


class Stage:
    """Records a scene frame by frame.

    Args:
        kind: of the scenes.
        figures: the people, who are posed anew before each `shoot`.
    """

    def __init__(self, kind: str, *figures: Figure) -> None:
        self.kind, self.figures = kind, figures
        self._stills: list[Figure] = []
        self._things: list[tuple[Thing, ...]] = []
        self._seeds = [int(f.rng.integers(1 << 31)) for f in figures]

    def shoot(self, *things: Built) -> None:
        """Keep the people as they are now, with `things`."""
        for f, seed in zip(self.figures, self._seeds, strict=True):
            still = copy.copy(f)
            still.local, still.root = f.local.copy(), f.root.copy()
            # Fingers bend alike in all frames.
            still.rng = np.random.default_rng(seed)
            still._grips = {s: f._grips.get(s) or "relaxed" for s in "LR"}
            self._stills.append(still)
        self._things.append(tuple(t.thing() for t in things))

    def scenes(self) -> list[Scene]:
        """The scene of each frame, its middle over the world's origin."""
        people = [p for k in range(0, len(self._stills), _AT_ONCE) for p in posed(*self._stills[k : k + _AT_ONCE])]
        count = len(self.figures)
        middle = np.mean([p.landmarks.mean(0) for p in people], 0) * [1, 1, 0]
        return [
            _moved(Scene(self.kind, tuple(people[t * count : (t + 1) * count]), things), -middle)
            for t, things in enumerate(self._things)
        ]


def _moved(scene: Scene, by: FloatArray) -> Scene:
    shift = by.astype(np.float32)
    for p in scene.people:
        p.vertices[:] += shift
        p.landmarks[:] += shift
    things = tuple(Thing(t.kind, t.vertices_world + shift, t.faces, t.colour, t.pattern, t.gloss) for t in scene.things)
    return Scene(scene.kind, scene.people, things)


def between_keys(times: Sequence[float], values: ArrayLike) -> Callable[[float], FloatArray]:
    """A smooth path (monotone cubic) through values (N, ...) at times in seconds; it rests before and after."""
    curve = PchipInterpolator(times, np.asarray(values, float))
    return lambda t: np.asarray(curve(np.clip(t, times[0], times[-1])))


def ease(t: float, start: float, end: float) -> float:
    """0 before `start`, 1 after `end`, smooth between."""
    u = float(np.clip((t - start) / (end - start), 0, 1))
    return u**3 * (10 - 15 * u + 6 * u * u)


def best_bend(f: Figure, bend: Callable[[float], None], targets: dict[str, FloatArray], want: float) -> float:
    """The bend of the trunk in degrees that brings the shoulders to a distance from the hands' places.

    Args:
        f: the person.
        bend: bends the trunk by so many degrees.
        targets: (3,) places by side.
        want: distance, as a share of an arm's length.
    """

    def off(total: float) -> float:
        bend(total)
        return max(abs(f.reach(s, at) - want) for s, at in targets.items())

    return float(minimize_scalar(off, bounds=_BENDS, method="bounded", options={"xatol": 0.1}).x)
