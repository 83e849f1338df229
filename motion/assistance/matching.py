"""Which captured fragments go best with key-framed ones, and which of these follow each other best.

After K. Pullen, C. Bregler, "Motion capture assisted animation: texturing and synthesis", 2002, sections 3.4 and 3.5:
fragments are stretched to one length and compared by the driving joints' values and slopes; of the nearest of each, a
path is chosen that goes on in one take where it can. The path is the best of all, by dynamic programming.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.geometry.numerics.rotations import conjugate_quat, multiply_quat, rotvec_from_quat
from muybridge.motion.assistance.fragments import Driving, Fragment, Signals, vectors_about

_SAMPLES = 12  # of a fragment that are compared
_SLOPE = 0.3  # how much a difference in slope, over the length of the fragment, counts beside one in value
_POSTURE = 0.05  # how much the square of a difference in posture counts
_STRETCHED = 1.0  # of the squared logarithm of the ratio of lengths
_RESIZED = 1.0  # of the squared logarithm of the ratio of sizes
_MOST_SCALE = 2.0
_GAP = 1.0  # radians of mean joint angle whose gap counts as much as a difference of one standard deviation
_LEAVING = 0.15  # of leaving a take, whatever the gap
_UNUSUAL = 0.5  # of a movement of the made joints that no other candidate shares
_PER_TAKE = 3  # candidates of one take that come first


@dataclass(frozen=True, eq=False)
class Match:
    """A captured fragment for each key-framed one.

    Attributes:
        fragments: of takes, one for each.
        costs: (N,) of each, as it was compared; 1 is a difference by one standard deviation of the movement.
    """

    fragments: tuple[Fragment, ...]
    costs: FloatArray


def match_fragments(
    wanted: Sequence[Fragment], keyed: Signals, captured: Sequence[Fragment], takes: Sequence[Signals],
    driving: Driving, poses: Sequence[FloatArray], candidates: int,
) -> Match:  # fmt: skip
    """The best path of captured fragments.

    Args:
        wanted: fragments of the key-framed clip, one behind the other.
        keyed: its signals.
        captured: fragments of all takes.
        takes: their signals.
        driving: the joints that drive.
        poses: (T, F, 4) of each take, rotations of the joints that are to be made, whose gaps count.
        candidates: nearest fragments that the path may choose from.
    """
    cost = fragment_costs(wanted, keyed, captured, takes, driving)
    nearest = _nearest(cost, np.array([f.clip for f in captured]), candidates)
    made = _made_movement(captured, poses)
    unusual = np.stack([_unusual(made[row], cost[n, row]) for n, row in enumerate(nearest)])
    ends = _end_poses(captured, poses)
    total = np.take_along_axis(cost, nearest, 1) + _UNUSUAL * unusual
    back = np.zeros(nearest.shape, np.intp)
    for n in range(1, len(wanted)):
        step = total[n - 1][:, None] + _joins(captured, ends, nearest[n - 1], nearest[n])
        back[n] = np.argmin(step, axis=0)
        total[n] += np.min(step, axis=0)
    at = int(np.argmin(total[-1]))
    chosen = []
    for n in range(len(wanted) - 1, -1, -1):
        chosen.append(int(nearest[n, at]))
        at = int(back[n, at])
    chosen = chosen[::-1]
    return Match(tuple(captured[c] for c in chosen), np.sqrt(cost[np.arange(len(wanted)), chosen]))


def _nearest(cost: FloatArray, clips: IndexArray, candidates: int) -> IndexArray:
    """(N, K) the captured fragments that each wanted one may get: few of each take, so that all takes have a say."""
    out = []
    for row in cost:
        order = np.argsort(row)
        seen: dict[int, int] = {}
        rank = np.empty(len(order), np.intp)
        for place, k in enumerate(order):
            rank[place] = seen[int(clips[k])] = seen.get(int(clips[k]), -1) + 1
        out.append(order[np.argsort(np.where(rank < _PER_TAKE, 0, 1), kind="stable")][:candidates])
    return np.stack(out)


def _made_movement(fragments: Sequence[Fragment], poses: Sequence[FloatArray]) -> FloatArray:
    """(M, S) radians: how the joints to be made move in each fragment, about their mean in the take."""
    moving = []
    for take in poses:
        mean = take.mean(axis=0)
        moving.append(vectors_about(mean / np.linalg.norm(mean, axis=-1, keepdims=True), take))
    at = [np.round(np.linspace(f.start, f.end, _SAMPLES // 2)).astype(np.intp) for f in fragments]
    return np.stack([moving[f.clip][k].ravel() for f, k in zip(fragments, at, strict=True)])


def _unusual(made: FloatArray, cost: FloatArray) -> FloatArray:
    """(K,) how far the movement of the joints to be made is from the mean of all candidates (K, S), the likelier ones
    counting more; one is a movement that has nothing in common with it.

    Of takes that fit alike, this chooses the one whose arms do what arms usually do, not the one who carries something.
    """
    weight = np.exp(-cost + cost.min())
    weight /= weight.sum()
    away = np.sum((made - weight @ made) ** 2, axis=1)
    return np.asarray(away / max(float(weight @ np.sum(made**2, axis=1)), 1e-9))


def fragment_costs(
    wanted: Sequence[Fragment], keyed: Signals, captured: Sequence[Fragment], takes: Sequence[Signals],
    driving: Driving,
) -> FloatArray:  # fmt: skip
    """(N, M) how much fragments differ: in squared standard deviations of the movement.

    A captured movement may be smaller or larger, and slower or faster, at a price.
    """
    ours, our_posture = _stacked([_sampled(f, keyed, driving) for f in wanted])
    theirs, their_posture = _stacked([_sampled(f, takes[f.clip], driving) for f in captured])
    size = np.sum(theirs**2, axis=1)[None]
    shared = ours @ theirs.T
    scale = np.clip(shared / np.maximum(size, 1e-9), 1 / _MOST_SCALE, _MOST_SCALE)
    cost = np.sum(ours**2, axis=1)[:, None] - 2 * scale * shared + scale**2 * size + _RESIZED * np.log(scale) ** 2
    posture = np.sum((our_posture[:, None] - their_posture[None]) ** 2, axis=-1)
    mine = np.array([(f.end - f.start) / keyed.fps for f in wanted])
    others = np.array([(f.end - f.start) / takes[f.clip].fps for f in captured])
    return np.asarray(
        np.maximum(cost, 0.0) + _POSTURE * posture + _STRETCHED * np.log(mine[:, None] / others[None]) ** 2
    )


def _stacked(parts: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    return np.stack([p[0] for p in parts]), np.stack([p[1] for p in parts])


def _sampled(fragment: Fragment, signals: Signals, driving: Driving) -> tuple[FloatArray, FloatArray]:
    """(S,) a fragment's movement and slope in samples, and (P,) its mean posture, in standard deviations."""
    at = np.linspace(fragment.start, fragment.end, _SAMPLES)
    before = np.minimum(at.astype(np.intp), len(signals.main) - 2)
    share = (at - before)[:, None]
    moving, rates, posture = (
        (1 - share) * x[before] + share * x[before + 1] for x in (signals.moving, signals.rates, signals.posture)
    )
    # Over the root of the number of samples, so that their squares add up to a mean.
    slopes = rates * (fragment.end - fragment.start) / signals.fps  # per fragment: it is stretched
    samples = np.concatenate([moving, _SLOPE * slopes], axis=1).ravel() / np.sqrt(_SAMPLES)
    return samples / driving.scale, posture.mean(axis=0) / driving.scale


def _end_poses(fragments: Sequence[Fragment], poses: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """(N, F, 4) rotations at the start and at the end of each fragment."""
    first = np.stack([poses[f.clip][f.start] for f in fragments])
    last = np.stack([poses[f.clip][f.end] for f in fragments])
    return first, last


def _joins(
    fragments: Sequence[Fragment], ends: tuple[FloatArray, FloatArray], before: FloatArray, after: FloatArray
) -> FloatArray:
    """(K, K) what it costs that one fragment follows another: nothing where it does in its take."""
    first, last = ends[0][after], ends[1][before]
    gap = rotvec_from_quat(multiply_quat(conjugate_quat(last[:, None]), first[None]))
    angle = np.sqrt(np.mean(np.sum(gap**2, axis=-1), axis=-1))
    out = (angle / _GAP) ** 2 * 4 + _LEAVING
    for i, a in enumerate(before):
        for j, b in enumerate(after):
            one, other = fragments[a], fragments[b]
            if one.clip == other.clip and one.number + 1 == other.number:
                out[i, j] = 0.0
    return np.asarray(out)
