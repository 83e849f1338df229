"""Seeded trials with known names for the labelling of markers: what laboratories really record.

A trial is a person of our own synthesis or of a recording, whose markers are placed as one laboratory would, with
markers beyond the set (medial ones, clusters, a knee alignment device, a stick, a puck), missing markers, gaps, broken
trajectories, a turned head, another vertical axis, and columns in any order.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.arrays import FloatArray
from muybridge.geometry.landmarks.marker_sets import SETS, SURFACE, MarkerSet

# Rotations from Z up to the axes of files.
_TURNS = {"+Z": np.eye(3), "+Y": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]),
          "-Y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])}  # fmt: skip
_HEAD = ("LFHD", "RFHD", "LBHD", "RBHD")
_MEDIAL = ("elbow_medial", "knee_medial", "malleolus_medial", "metatarsal_5", "metatarsal_1", "hallux", "patella",
           "tibial_tuberosity", "trochanter", "iliac_crest", "metacarpal_5")  # fmt: skip


@dataclass(frozen=True)
class Person:
    """Labelled markers.

    Attributes:
        points: (T, M, 3) metres, Z up.
        labels: (M,) of the set, "" for a marker beyond it.
        fps: frames per second.
        markers: the set asked for.
    """

    points: FloatArray
    labels: tuple[str, ...]
    fps: float
    markers: MarkerSet


@dataclass(frozen=True)
class Trial:
    """A trial.

    Attributes:
        cloud: (T, K, 3) metres, the file's axes.
        truth: (T, A, 3) the set's markers in them, NaN where hidden or not worn.
        fps: frames per second.
        markers: the set asked for.
        up: (3,) what the file says is up; None where it says nothing.
        kind: words for the faults.
    """

    cloud: FloatArray
    truth: FloatArray
    fps: float
    markers: MarkerSet
    up: FloatArray | None
    kind: tuple[str, ...]


def made_people(count: int, seed: int, distance_m: FloatArray, motion_m: FloatArray,
                sets: Sequence[str]) -> list[Person]:  # fmt: skip
    """People of our own synthesis; needs the training packages.

    Args:
        count: number of people.
        seed: random seed.
        distance_m: (L, L) mean distances of the surface points, of the labelling network's metadata.
        motion_m: (L, L) their variation in motion: markers are displaced along the most rigid directions.
        sets: names of marker sets, used in turn.
    """
    from muybridge.train.synthesis.bodies.surface_markers import marker_table
    from muybridge.train.synthesis.markers.trajectories import FPS, MarkerBodies

    bodies = MarkerBodies(0)
    bodies.reseed(seed)
    clips = bodies.clips(count).points.astype(np.float64)
    rng = np.random.default_rng(seed)
    people = []
    for i, at in enumerate(clips):
        at = _placed(at[:150], marker_table().tolerance_m.astype(float), distance_m, motion_m, rng)
        markers = _random_set(61, rng) if sets[i % len(sets)] == "set61" else SETS[sets[i % len(sets)]]
        own = list(markers.surface_indices)
        more = [k for k, n in enumerate(SURFACE.names) if k not in own and any(stem in n for stem in _MEDIAL)]
        labels = (*markers.labels, *("" for _ in more))
        people.append(Person(at[:, own + more], labels, FPS, markers))
    return people


def _random_set(size: int, rng: np.random.Generator) -> MarkerSet:
    chosen = sorted(rng.permutation(len(SURFACE))[:size].tolist())
    names = tuple(SURFACE.names[k] for k in chosen)
    return MarkerSet("set61", names, (), tuple(n.replace("left_", "L").replace("right_", "R") for n in names))


def _placed(at: FloatArray, tolerance: FloatArray, distance: FloatArray, motion: FloatArray,
            rng: np.random.Generator) -> FloatArray:  # fmt: skip
    """Markers placed by one examiner: displaced with the segment that they sit on, the head's band as it was worn."""
    out = at.copy()
    for k in range(at.shape[1]):
        if SURFACE.names[k].endswith("_head"):
            continue  # A band is worn as a whole.
        order = np.argsort(motion[k] + 0.02 * distance[k] + 9.0 * (np.arange(len(motion)) == k))[:4]
        sides = at[:, order] - at[:, [k]]
        length = np.linalg.norm(sides, axis=-1, keepdims=True).mean(0)
        out[:, k] += (sides / length * rng.normal(0, 0.75 * tolerance[k], (4, 1))).sum(1)
    head = [SURFACE.index(f"{s}_{e}_head") for e in ("front", "back") for s in ("left", "right")]
    middle = out[:, head].mean(1, keepdims=True)
    ahead = out[:, head[:2]].mean(1) - out[:, head[2:]].mean(1)
    across = out[:, head[0]] - out[:, head[1]]
    up = np.cross(ahead, across)
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    deep, wide, low = rng.uniform(0.9, 1.4), rng.uniform(0.75, 1.2), rng.uniform(-0.03, 0.06)
    for j, k in enumerate(head):
        front, left = (1 if j < 2 else -1), (1 if j % 2 == 0 else -1)
        out[:, k] = middle[:, 0] + front * (deep * ahead / 2 + low / 2 * up) + left * wide * across / 2
    return out + rng.normal(0, 4e-4, out.shape)


def recorded_person(path: Path, markers: MarkerSet) -> Person:
    """A labelled recording, whose other markers are kept as markers beyond the set; Z up."""
    from muybridge.motion.formats.points.unlabelled import read_marker_cloud

    cloud = read_marker_cloud(path)
    names = [n.split(":")[-1] for n in cloud.names]
    kept = [i for i, n in enumerate(names) if n in markers.labels]
    return Person(cloud.points[:, kept], tuple(names[i] for i in kept), cloud.fps, markers)


def make_trial(person: Person, rng: np.random.Generator, plain: bool = False) -> Trial:
    """One trial of a person; `plain` leaves out every fault but the order of the columns."""
    at, labels, kind = person.points.copy(), list(person.labels), []
    if not plain and rng.random() < 0.4:
        at = _turn_head(at, labels, float(rng.uniform(-60, 60)))
        kind.append("head")
    worn = [i for i, label in enumerate(labels) if label]
    beyond = [at[:, i] for i, label in enumerate(labels) if not label and not plain and rng.random() < 0.25]
    if beyond:
        kind.append("medial")
    for name, chance, make in () if plain else _DEVICES:
        if rng.random() < chance and (extra := make(at, labels, rng)) is not None:
            beyond += list(np.moveaxis(extra, 1, 0))
            kind.append(name)
    if not plain and rng.random() < 0.5:
        gone = rng.permutation(worn)[: rng.integers(1, 4)].tolist()
        worn = [i for i in worn if i not in gone]
        kind.append("missing")
    truth = np.full((len(at), len(person.markers), 3), np.nan)
    truth[:, [person.markers.labels.index(labels[i]) for i in worn]] = at[:, worn]
    if not plain:
        _hide(truth, rng)
    columns = [truth[:, a] for a in range(truth.shape[1]) if np.isfinite(truth[:, a, 0]).any()] + beyond
    if not plain and rng.random() < 0.4:
        columns = _broken(columns, int(rng.integers(5, 40)), rng)
        kind.append("broken")
    cloud = np.stack([columns[i] for i in rng.permutation(len(columns))], 1)
    yaw = Rotation.from_euler("z", rng.uniform(0, 360), degrees=True).as_matrix()
    up = "+Z" if plain or rng.random() < 0.6 else str(rng.choice(["+Y", "-Y"]))
    turn = _TURNS[up] @ yaw
    stated = turn @ [0.0, 0.0, 1.0] if up == "-Y" or rng.random() < 0.4 else None
    kind += [up, *(["stated"] if stated is not None else [])]
    return Trial(cloud @ turn.T, truth @ turn.T, person.fps, person.markers, stated, tuple(kind))


def _at(at: FloatArray, labels: list[str], *names: str) -> FloatArray | None:
    found = [at[:, labels.index(n)] for n in names if n in labels]
    return np.stack(found, 1) if len(found) == len(names) else None


def _turn_head(at: FloatArray, labels: list[str], degrees: float) -> FloatArray:
    head = _at(at, labels, *_HEAD)
    if head is None:
        return at
    pivot = head.mean(1, keepdims=True) * [1, 1, 1]
    if (neck := _at(at, labels, "C7", "CLAV")) is not None:
        pivot = 0.6 * pivot + 0.4 * neck.mean(1, keepdims=True)
    turned = Rotation.from_euler("z", degrees, degrees=True).apply((head - pivot).reshape(-1, 3)).reshape(head.shape)
    out = at.copy()
    out[:, [labels.index(n) for n in _HEAD]] = turned + pivot
    return out


def _segment(at: FloatArray, labels: list[str], side: str, upper: bool) -> tuple[FloatArray, ...] | None:
    """Ends of a thigh or shank and its directions along, outwards and ahead, (T, 3) each."""
    leg = _at(at, labels, *((f"{side}ASI", f"{side}KNE") if upper else (f"{side}KNE", f"{side}ANK")))
    hips = _at(at, labels, f"{side}ASI", f"{'R' if side == 'L' else 'L'}ASI")
    if leg is None or hips is None:
        return None
    along, out = leg[:, 1] - leg[:, 0], hips[:, 0] - hips[:, 1]
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    out = out - along * (along * out).sum(-1, keepdims=True)
    out = out / np.linalg.norm(out, axis=-1, keepdims=True)
    return leg[:, 0], leg[:, 1], along, out, np.cross(along, out)


def _clusters(at: FloatArray, labels: list[str], rng: np.random.Generator) -> FloatArray | None:
    made = []
    for side in "LR":
        for upper in (True, False):
            if (found := _segment(at, labels, side, upper)) is None:
                return None
            a, b, along, out, ahead = found
            middle = a + (b - a) * rng.uniform(0.4, 0.7) + out * rng.uniform(0.03, 0.08)
            for x, y in ((-1, -1), (-1, 1), (1, 1), (1, -1))[: rng.integers(3, 5)]:
                made.append(middle + along * x * rng.uniform(0.02, 0.05) + ahead * y * rng.uniform(0.02, 0.05))
    return np.stack(made, 1)


def _alignment(at: FloatArray, labels: list[str], rng: np.random.Generator) -> FloatArray | None:
    """Knee alignment devices: three points beside each knee."""
    made = []
    for side in "LR":
        if (found := _segment(at, labels, side, True)) is None:
            return None
        _, knee, along, out, ahead = found
        base = knee + out * 0.02
        made += [base + out * 0.1, base + along * 0.08 + out * 0.04, base + ahead * 0.08 + out * 0.04]
    return np.stack(made, 1)


def _inside(at: FloatArray, labels: list[str], rng: np.random.Generator) -> FloatArray | None:
    """Medial knees and ankles."""
    made = []
    for side in "LR":
        if (found := _segment(at, labels, side, True)) is None:
            return None
        knee, out = found[1], found[3]
        ankle = _at(at, labels, f"{side}ANK")
        made += [knee - out * rng.uniform(0.09, 0.13)]
        made += [] if ankle is None else [ankle[:, 0] - out * rng.uniform(0.06, 0.09)]
    return np.stack(made, 1)


def _stick(at: FloatArray, labels: list[str], rng: np.random.Generator) -> FloatArray | None:
    arm = _at(at, labels, "RELB", "RWRA")
    if arm is None:
        return None
    along = arm[:, 1] - arm[:, 0]
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    down = np.cross(along, rng.normal(size=3))
    down /= np.linalg.norm(down, axis=-1, keepdims=True)
    return np.stack([arm[:, 1] + along * 0.08 + (0.5 * along + down) * x for x in (0.05, 0.3, 0.55, 0.8)], 1)


def _floor(at: FloatArray, labels: list[str], rng: np.random.Generator) -> FloatArray | None:
    """A puck that glides, and a marker that lies beside."""
    low = np.nanmin(at[..., 2])
    middle = np.nanmean(at, (0, 1)) * [1, 1, 0] + [0, 0, low + 0.03]
    path = (
        middle
        + rng.normal(0, 0.5, 3) * [1, 1, 0]
        + np.outer(np.linspace(-1, 1, len(at)), rng.normal(0, 1, 3) * [1, 1, 0])
    )
    return np.stack([path, np.tile(middle + [0.6, 0.4, 0.0], (len(at), 1))], 1)


_DEVICES = (("clusters", 0.3, _clusters), ("alignment", 0.15, _alignment), ("inside", 0.3, _inside),
            ("stick", 0.2, _stick), ("floor", 0.2, _floor))  # fmt: skip


def _hide(truth: FloatArray, rng: np.random.Generator, share: float = 0.02) -> None:
    """Gaps whose lengths follow those of real recordings."""
    hidden, count = 0, len(truth)
    while hidden < share * truth.shape[0] * truth.shape[1]:
        length = int(min(count // 2, max(1, rng.lognormal(1.8, 1.6))))
        start = int(rng.integers(0, count - length))
        truth[start : start + length, rng.integers(truth.shape[1])] = np.nan
        hidden += length


def _broken(columns: list[FloatArray], cuts: int, rng: np.random.Generator) -> list[FloatArray]:
    out = list(columns)
    for _ in range(cuts):
        i, cut = int(rng.integers(len(out))), int(rng.integers(1, len(columns[0]) - 1))
        before = np.arange(len(columns[0]))[:, None] < cut
        head, tail = np.where(before, out[i], np.nan), np.where(before, np.nan, out[i])
        if np.isfinite(head).any() and np.isfinite(tail).any():
            out[i] = head
            out.append(tail)
    return out
