"""Motion graphs: clips of one skeleton, and the transitions by which one goes on into another.

Kovar, Gleicher and Pighin 2002, "Motion Graphs". A walk in the graph plays frames of a clip, leaves it by a transition,
in which two windows are blended, and goes on behind the window of the other clip.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from muybridge.arrays import BoolArray, IntArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics.rotations import continuous_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.graphs.components import Choice, choose_threshold, in_largest_component
from muybridge.motion.graphs.distances import lag_distances, window_features
from muybridge.motion.graphs.minima import find_minima
from muybridge.motion.graphs.transitions import Transitions, candidates


@dataclass(frozen=True)
class GraphOptions:
    """How a motion graph is built.

    Attributes:
        window: seconds over which two motions are compared, and blended.
        threshold: metres, root mean square distance of the points of two windows; None chooses it: see
            `choose_threshold`.
        apart: seconds between two moments of one clip that a transition may join.
        spacing: seconds around a transition in which there is no better one from and to nearby frames.
        most: transitions of a frame within its clip, and to other clips; the best ones.
    """

    window: float = 1 / 3
    threshold: float | None = None
    apart: float = 0.5
    spacing: float = 0.1
    most: int = 8


@dataclass(frozen=True, eq=False)
class MotionGraph:
    """Clips and transitions between them.

    Attributes:
        motion: (F frames) all clips, one behind the other.
        starts: (C + 1,) first frame of each clip, and the number of all frames.
        names: of the clips.
        labels: of the clips: what is done in them.
        window: frames of a transition.
        threshold: metres, of the transitions' distance.
        transitions: those within the largest strongly connected component.
        component: (F,) whether a frame is in it.
    """

    motion: Motion
    starts: IntArray
    names: tuple[str, ...]
    labels: tuple[str, ...]
    window: int
    threshold: float
    transitions: Transitions
    component: BoolArray

    def __len__(self) -> int:
        return len(self.motion)

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self.motion.fps

    @cached_property
    def clip_of(self) -> IntArray:
        """(F,) number of the clip of each frame."""
        return np.repeat(np.arange(len(self.names)), np.diff(self.starts))

    @cached_property
    def first_leaving(self) -> IntArray:
        """(F + 1,) of each frame, the number of the first transition that leaves there or later."""
        return np.searchsorted(self.transitions.leave, np.arange(len(self) + 1)).astype(np.int64)

    def clip(self, number: int) -> Motion:
        """One of the clips."""
        return self.motion.select(slice(int(self.starts[number]), int(self.starts[number + 1])))


@dataclass(frozen=True, eq=False)
class Built:
    """A graph, and how it came about.

    Attributes:
        graph: the graph.
        choice: of the threshold.
        passed_over: numbers of clips that are shorter than a window and one frame.
        rough: transitions left out because a joint would accelerate harder in them than it ever does in the clips.
    """

    graph: MotionGraph
    choice: Choice
    passed_over: tuple[int, ...]
    rough: int


def build_graph(
    clips: Sequence[Motion], names: Sequence[str], labels: Sequence[str] | None = None,
    options: GraphOptions | None = None, advance: Callable[[int], object] | None = None,
) -> Built:  # fmt: skip
    """A motion graph of clips.

    Args:
        clips: of one skeleton and frame rate, Z up (`muybridge.motion.blending.same_skeleton` sees to that).
        names: of the clips.
        labels: of the clips; None for their names.
        options: how.
        advance: called with 1 for each block of distances (`muybridge.motion.graphs.minima.blocks_of`).

    Raises:
        MuybridgeError: every clip is shorter than the window, or no transition leads back to where one was.
        ValueError: there is no clip, or an option is out of range.
    """
    options = options or GraphOptions()
    _check(clips, options)
    fps = clips[0].fps
    window = max(round(options.window * fps), 2)
    long = [k for k, clip in enumerate(clips) if len(clip) > window]
    if not long:
        longest = max(range(len(clips)), key=lambda k: len(clips[k]))
        raise MuybridgeError(
            f"no clip is longer than the window of {window} frames ({window / fps:.3g} s), in which two motions are "
            f"blended; the longest, {names[longest]}, has {len(clips[longest])}"
        )
    kept = [clips[k] for k in long]
    features = window_features(kept, window)
    radius, gap = max(round(options.spacing * fps), 1), max(round(options.apart * fps), 1)
    minima = find_minima(features, radius, gap, options.most, advance)
    ways, rough = candidates(kept, minima, window)
    starts = np.concatenate([[0], np.cumsum([len(c) for c in kept])]).astype(np.int64)
    lags = lag_distances(features, max(window // 2, 1))
    choice = choose_threshold(ways, starts, window, options.threshold, lags)
    ways = ways.select(ways.distance <= choice.threshold)
    component = in_largest_component(ways.leave, ways.enter, starts, window)
    ways = ways.select(component[ways.leave] & component[np.minimum(ways.enter + window, len(component) - 1)])
    graph = MotionGraph(
        concatenated(kept), starts, tuple(names[k] for k in long),
        tuple((names if labels is None else labels)[k] for k in long), window, choice.threshold, ways, component,
    )  # fmt: skip
    return Built(graph, choice, tuple(k for k in range(len(clips)) if k not in long), rough)


def _check(clips: Sequence[Motion], options: GraphOptions) -> None:
    if not clips:
        raise ValueError("a graph needs at least one clip")
    if not (0 < options.window < np.inf and 0 <= options.apart < np.inf and 0 <= options.spacing < np.inf):
        raise ValueError("window must be above zero; apart and spacing at least zero, all in seconds")
    if options.threshold is not None and not 0 < options.threshold < np.inf:
        raise ValueError(f"threshold must be above zero metres, not {options.threshold:g}")
    if options.most < 1:
        raise ValueError("most must be at least 1")


def concatenated(clips: Sequence[Motion]) -> Motion:
    """All clips, one behind the other."""
    first = clips[0]
    slides = [c.translations for c in clips if c.translations is not None]
    return Motion(
        first.skeleton, first.fps,
        np.concatenate([c.root_positions_world for c in clips]),
        continuous_quat(np.concatenate([c.quat_wxyz for c in clips])),
        np.concatenate(slides) if slides else None,
    )  # fmt: skip
