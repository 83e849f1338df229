"""A labelling judged as a whole: every name against all others, by what is known about bodies before the person is.

Names of single points can each look good and still be wrong together: a row of markers named one further, a marker
beyond the set in place of its neighbour. The quality of a whole labelling is the network's scores, distances between
all markers against those of bodies (with the placement of laboratories), how rigid they are, and how alike the left
and the right are. It is improved by exchanges, and its loss under the best alternative tells how sure a name is.
"""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import BoolArray, FloatArray, IndexArray
from muybridge.geometry.markers.fit import fit_of, geometry_of, quality_of
from muybridge.geometry.numerics._numba import compiled_with


@dataclass(frozen=True)
class WholeOptions:
    """How a whole labelling is judged.

    Attributes:
        frames: largest number of frames that are looked at.
        floor: smallest log probability that the network can hold against a name.
        network: weight of the network's mean log probability.
        present: what a name found is worth: laboratories wear most of their set.
        links: number of partners of a marker: those whose distance to it is known best.
        distance: weight of a distance.
        rigid: weight of how little a distance varies.
        alike: weight of a distance that is like its mirror image.
        placed_m: standard deviation of distances by the placement of markers, metres; a share of the distance is added.
        placed: that share.
        head_m: the same for markers of the head: bands and caps differ more.
        rounds: searches per marker.
        near_m: a name moves to points within this distance, metres.
        share: smallest share of the frames that an unnamed trajectory must be visible in to get a name as a whole.
        group: weight of the network within a group whose order it may mistake as a whole (head, hand, foot, pelvis).
    """

    frames: int = 100
    floor: float = -6.0
    network: float = 0.7
    links: int = 8
    present: float = 1.5
    distance: float = 1.0
    rigid: float = 2.0
    alike: float = 1.0
    placed_m: float = 0.012
    placed: float = 0.05
    head_m: float = 0.03
    near_m: float = 0.45
    rounds: int = 4
    share: float = 0.2
    group: float = 0.1


@dataclass(frozen=True)
class Bodies:
    """What is known about the distances of a set's A markers before the person is known.

    Attributes:
        distance_m: (A, A) mean, metres.
        sigma_m: (A, A) standard deviation between people and laboratories, metres.
        motion_m: (A, A) standard deviation while a person moves, metres.
        linked: (A, A) weight of a pair, 0 where its distance says little.
        twin: (A,) the marker on the same place of the other side, its own where there is none.
    """

    distance_m: FloatArray
    sigma_m: FloatArray
    motion_m: FloatArray
    linked: FloatArray
    twin: IndexArray


def known_bodies(distance_m: FloatArray, motion_m: FloatArray, bodies_m: FloatArray, names: tuple[str, ...],
                 options: WholeOptions = WholeOptions()) -> Bodies:  # fmt: skip
    """What the labelling network's metadata say about a set.

    Args:
        distance_m: (A, A) mean distances, metres.
        motion_m: (A, A) their standard deviation by motion, metres.
        bodies_m: (A, A) their standard deviation between bodies, metres.
        names: (A,) body points of the markers, as in `SURFACE`.
        options: see `WholeOptions`.
    """
    size = len(names)
    head = np.array([n.endswith("_head") for n in names])
    placed = np.where(head[:, None] | head, options.head_m, options.placed_m + options.placed * distance_m)
    sigma = np.sqrt((1.3 * bodies_m) ** 2 + placed**2)
    loose = np.hypot(sigma, motion_m) + 1e3 * np.eye(size)
    order = np.argsort(loose, 1, kind="stable")[:, : min(options.links, size - 1)]
    linked = np.zeros((size, size))
    linked[np.arange(size)[:, None], order] = 1.0
    linked = np.maximum(linked, linked.T)
    flip = {"left": "right", "right": "left"}
    place = {n: i for i, n in enumerate(names)}
    twin = np.array([place.get("_".join([flip.get(n.split("_")[0], ""), *n.split("_")[1:]]), i)
                     for i, n in enumerate(names)], np.intp)  # fmt: skip
    linked = np.maximum(linked, linked[np.ix_(twin, twin)])
    return Bodies(distance_m, sigma, motion_m, linked, twin)


@dataclass(frozen=True)
class Columns:
    """K candidates for names: what has each of the A names now (in this order), then long trajectories without one.

    Attributes:
        place: (F, K, 3) metres in a sample of frames, NaN where missing.
        gain: (K, A) mean log probability of each name over that of none.
        mean_m: (K, K) mean distances, metres.
        spread_m: (K, K) standard deviations, metres.
        known: (K, K) weight of a pair by the frames in which both are visible, 0 to 1.
        piece: (K,) number of the unnamed trajectory, -1 for the names.
    """

    place: FloatArray
    gain: FloatArray
    mean_m: FloatArray
    spread_m: FloatArray
    known: FloatArray
    piece: IndexArray


def find_columns(points: FloatArray, track: IndexArray, label: IndexArray, scores: FloatArray,
                 options: WholeOptions = WholeOptions(), present: FloatArray | None = None) -> Columns:  # fmt: skip
    """Candidates for names.

    Args:
        points: (T, S, 3) metres, NaN where there is no point.
        track: (T, S) number of the trajectory, -1 for none.
        label: (T, S) labels so far, -1 for none.
        scores: (T, S, A + 1) log probabilities, the last for none; NaN where there is no point.
        options: see `WholeOptions`.
        present: (A,) what every name found is worth, in place of that of the options.
    """
    size = scores.shape[2] - 1
    frames = np.unique(np.linspace(0, len(points) - 1, min(options.frames, len(points))).astype(int))
    points, track, label, scores = points[frames], track[frames], label[frames], scores[frames]
    number, count = np.unique(track[(label < 0) & (track >= 0)], return_counts=True)
    piece = number[count >= max(2, options.share * len(frames))]
    column = np.where(label >= 0, label, -1)
    place_of = np.full(int(track.max(initial=-1)) + 2, -1, np.intp)
    place_of[piece] = size + np.arange(len(piece))
    column = np.where((label < 0) & (track >= 0), place_of[track], column)
    t, s = np.nonzero(column >= 0)
    k = column[t, s]
    place = np.full((len(frames), size + len(piece), 3), np.nan)
    place[t, k] = points[t, s]
    votes = np.maximum(scores[t, s], options.floor)
    gain = np.zeros((place.shape[1], size))
    np.add.at(gain, k, votes[:, :-1] - votes[:, -1:])
    gain /= np.maximum(np.bincount(k, minlength=len(gain)), 1)[:, None]
    mean, spread, known = _pairs(place)
    gain += options.present if present is None else present
    return Columns(place, gain, mean, spread, known, np.concatenate([np.full(size, -1), piece]))


@compiled_with()
def _pairs(place: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    frames, size = place.shape[:2]
    mean, spread, known = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size))
    for i in range(size):
        for j in range(i):
            total, square, count = 0.0, 0.0, 0
            for t in range(frames):
                if np.isfinite(place[t, i, 0]) and np.isfinite(place[t, j, 0]):
                    x = place[t, i, 0] - place[t, j, 0]
                    y = place[t, i, 1] - place[t, j, 1]
                    z = place[t, i, 2] - place[t, j, 2]
                    r = x * x + y * y + z * z
                    total += np.sqrt(r)
                    square += r
                    count += 1
            if count:
                m = total / count
                v = np.sqrt(max(square / count - m * m, 0.0))
                mean[i, j] = mean[j, i] = m
                spread[i, j] = spread[j, i] = v
                known[i, j] = known[j, i] = count / (count + 0.05 * frames)
    return mean, spread, known


@compiled_with()
def _alternatives(chosen: IndexArray, gain: FloatArray, near: BoolArray, seen: FloatArray, known: FloatArray,
                  twin: IndexArray, scale: float, weights: FloatArray) -> FloatArray:  # fmt: skip
    columns, size = gain.shape
    out = np.full((size, columns + 1), -np.inf)
    owner = np.full(columns, -1, np.intp)
    for a in range(size):
        if chosen[a] >= 0:
            owner[chosen[a]] = a
    trial = chosen.copy()
    for a in range(size):
        old = chosen[a]
        alone = 0.0
        trial[a] = -1
        if old >= 0:
            alone = gain[old, a] + fit_of(a, old, trial, seen, known, twin, scale, weights)
            out[a, columns] = -alone
        for k in range(columns):
            if k == old:
                out[a, k] = 0.0
            elif near[a, k]:
                b = owner[k]
                loss = alone
                if b >= 0:
                    trial[b] = -1
                    loss += gain[k, b] + fit_of(b, k, trial, seen, known, twin, scale, weights)
                value = gain[k, a] + fit_of(a, k, trial, seen, known, twin, scale, weights)
                if b >= 0 and old >= 0:
                    trial[a] = k
                    back = gain[old, b] + fit_of(b, old, trial, seen, known, twin, scale, weights)
                    value += max(back, 0.0)
                    trial[a] = -1
                if b >= 0:
                    trial[b] = k
                out[a, k] = value - loss
        trial[a] = old
    return out


@compiled_with()
def _search(chosen: IndexArray, gain: FloatArray, near: BoolArray, seen: FloatArray, known: FloatArray,
            twin: IndexArray, scale: float, weights: FloatArray, rounds: int,
            rng: np.random.Generator) -> IndexArray:  # fmt: skip
    """Take the names of neighbours away and give them again, best first, as long as that improves the whole."""
    columns, size = gain.shape
    best = chosen.copy()
    reached = quality_of(best, gain, seen, known, twin, scale, weights)
    trial, removed = chosen.copy(), np.zeros(size, np.bool_)
    for turn in range(rounds):
        centre = turn % size if turn < size else int(rng.random() * size)
        before, after = 0.0, 0.0
        trial[:], removed[:] = best, False
        share = 0.5 + 0.5 * rng.random()
        for b in range(size):
            if b == centre or (known[3, centre, b] > 0.0 and rng.random() < share):
                removed[b] = True
                if trial[b] >= 0:
                    k, trial[b] = trial[b], -1
                    before += gain[k, b] + fit_of(b, k, trial, seen, known, twin, scale, weights)
        taken = np.zeros(columns, np.bool_)
        for b in range(size):
            if trial[b] >= 0:
                taken[trial[b]] = True
        while True:
            most, who, where = 0.0, -1, -1
            for b in range(size):
                if removed[b]:
                    for k in range(columns):
                        if near[b, k] and not taken[k]:
                            value = gain[k, b] + fit_of(b, k, trial, seen, known, twin, scale, weights)
                            value += rng.random() * 1.0 if turn >= size else 0.0
                            if value > most:
                                most, who, where = value, b, k
            if who < 0:
                break
            after += gain[where, who] + fit_of(who, where, trial, seen, known, twin, scale, weights)
            trial[who], taken[where], removed[who] = where, True, False
        # The sums leave out the mirror images of names that were taken away at the time; the whole decides.
        if after > before + 1e-6:
            value = quality_of(trial, gain, seen, known, twin, scale, weights)
            if value > reached + 1e-6:
                best[:], reached = trial, value
    return best


class Judge:
    """Quality of labellings of the same columns.

    Attributes:
        scale: the person's size relative to the bodies' mean.
    """

    def __init__(self, columns: Columns, bodies: Bodies, options: WholeOptions = WholeOptions()) -> None:
        self.columns, self.bodies, self.options = columns, bodies, options
        self.weights = np.array([options.distance, options.rigid, options.alike])
        self.seen = np.stack([columns.mean_m, columns.spread_m, columns.known])
        self.known = np.stack([bodies.distance_m, bodies.sigma_m, bodies.motion_m, bodies.linked])
        self.scale = 1.0
        size = len(bodies.twin)
        self.start = np.where(np.isfinite(columns.place[:, :size, 0]).any(0), np.arange(size), -1)
        self.scale = self._scale()

    def _scale(self) -> float:
        size = len(self.start)
        use = (self.bodies.linked > 0) & (self.columns.known[:size, :size] > 0) & (self.bodies.motion_m < 0.03)
        if use.sum() < 6:
            return 1.0
        ratio = self.columns.mean_m[:size, :size][use] / self.bodies.distance_m[use]
        return float(np.clip(np.median(ratio), 0.8, 1.25))

    def geometry(self, chosen: IndexArray) -> float:
        """Fit of the distances if label a is column `chosen[a]`."""
        return float(geometry_of(chosen, self.seen, self.known, self.bodies.twin, self.scale, self.weights))

    def network(self, chosen: IndexArray) -> float:
        """The network's mean log probabilities."""
        named = np.nonzero(chosen >= 0)[0]
        return self.options.network * float(self.columns.gain[chosen[named], named].sum())

    def quality(self, chosen: IndexArray) -> float:
        """Of the whole labelling."""
        return self.geometry(chosen) + self.network(chosen)

    def improve(self, chosen: IndexArray, rounds: int | None = None) -> IndexArray:
        """Exchange names, and names for unnamed columns, as long as that improves the whole."""
        rounds = self.options.rounds * len(chosen) if rounds is None else rounds
        return _search(chosen, self.options.network * self.columns.gain, self._near(chosen), self.seen, self.known,
                       self.bodies.twin, self.scale, self.weights, rounds, np.random.default_rng(0))  # fmt: skip

    def alternatives(self, chosen: IndexArray) -> FloatArray:
        """(A, K + 1) what the whole gains if a label moves to another column, and that column's label takes the place
        in exchange; the last for no column. 0 for its own, -inf where it is too far."""
        return _alternatives(chosen, self.options.network * self.columns.gain, self._near(chosen), self.seen,
                             self.known, self.bodies.twin, self.scale, self.weights)  # fmt: skip

    def fit(self, chosen: IndexArray) -> FloatArray:
        """(A,) how well each label's distances fit, per partner; 0 for those without a column."""
        out = np.zeros(len(chosen))
        for a in np.nonzero(chosen >= 0)[0]:
            partners = max(int(((self.bodies.linked[a] > 0) & (chosen >= 0)).sum()), 1)
            out[a] = fit_of(int(a), int(chosen[a]), chosen, self.seen, self.known, self.bodies.twin, self.scale,
                            self.weights) / partners  # fmt: skip
        return out

    def _near(self, chosen: IndexArray) -> BoolArray:
        """(A, K) columns that a label may move to."""
        c, b = self.columns, self.bodies
        near = c.gain > self.options.floor / 2
        for a, k in enumerate(chosen):
            if k >= 0:
                near[:, a] |= (c.known[k] > 0) & (c.mean_m[k] < self.options.near_m)
                if chosen[b.twin[a]] >= 0:
                    near[chosen[b.twin[a]], a] = True
        return np.ascontiguousarray(near.T & np.isfinite(c.place[..., 0]).any(0))
