"""Distances between two results, points or motions of any format."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.errors import FormatError
from muybridge.files import replacing
from muybridge.geometry.numerics.rotations import kabsch
from muybridge.geometry.skeleton.aliases import map_body, map_surface, of_one_subject, one_of_several
from muybridge.geometry.skeleton.profiles import roles_of
from muybridge.infer.runtime.reading import read_for_command
from muybridge.motion.formats.registry import ReadOptions, can_use

Align = Literal["none", "root", "rigid", "similarity"]


@dataclass(frozen=True, eq=False)
class Comparison:
    """Two results over the same frames.

    Attributes:
        names: (J,) landmarks or joints that both have.
        distance_m: (T, J) after alignment; NaN where one has no point.
        times: (T,) seconds.
        scale: factor of the second result; 1 unless aligned by a similarity.
        how: the alignment, as the end of a sentence.
        notices: what the user should know, a sentence each.
    """

    names: tuple[str, ...]
    distance_m: FloatArray
    times: FloatArray
    scale: float
    how: str
    notices: tuple[str, ...] = ()


@dataclass(frozen=True)
class PairOptions:
    """What two files do not say, or say wrongly; None where they do.

    Attributes:
        units: of lengths.
        up: axis that is up.
        fps: frames per second.
    """

    units: tuple[str, str] | None = None
    up: tuple[str, str] | None = None
    fps: tuple[float, float] | None = None

    def of(self, k: int, paths: tuple[Path, Path]) -> ReadOptions:
        """Options of the k-th file: what only the other file leaves open has to be given for both."""
        given: dict[str, Any] = {}
        for name, pair in (("units", self.units), ("up", self.up), ("fps", self.fps)):
            if pair is not None and (can_use(paths[k], name) or not can_use(paths[1 - k], name)):
                given[name] = pair[k]
        return ReadOptions(**given)


def compare_files(
    paths: tuple[Path, Path],
    align: Align = "none",
    shift: float = 0.0,
    options: PairOptions = PairOptions(),  # noqa: B008
) -> tuple[Comparison, float]:
    """Distances between the points of two files.

    Args:
        paths: A, and B, which is aligned to A.
        align: see `compare_points`.
        shift: seconds that B is behind A.
        options: what the files do not say.

    Returns:
        The comparison, and the seconds by which B begins later in its recording than A does in its own; 0 where that
        is less than half a frame.

    Raises:
        MuybridgeError: a file cannot be read, or they have nothing in common.
    """
    first, second = (read_for_command(path, options.of(k, paths)) for k, path in enumerate(paths))
    found = compare_points(first.positions, second.positions, align, shift, (paths[0].name, paths[1].name))
    late = second.start - first.start
    if abs(late) <= 0.5 / max(first.fps, second.fps):
        late = 0.0
    return replace(found, notices=(*first.notices, *second.notices, *found.notices)), late


def compare_points(
    first: Any, second: Any, align: Align = "none", shift: float = 0.0, called: tuple[str, str] = ("A", "B")
) -> Comparison:
    """Distances between two sets of points over their common time.

    Args:
        first: Points3D A.
        second: Points3D B.
        align: how B is aligned to A: not at all; by the root (the middle of the hips) in every frame; by one rigid
            transformation of the whole take; by one similarity transformation.
        shift: seconds that B is behind A: B's time t is compared with A's t + shift.
        called: names of the two in messages.

    Raises:
        FormatError: they have no landmark or no time in common.
    """
    names, columns = _match(first, second, called)
    a, b = first.points_world[:, columns[0]], second.points_world[:, columns[1]]
    times, a, b = _common_time(a, b, first.fps, second.fps, shift, called)
    both = np.asarray(np.isfinite(a + b).all(axis=-1))
    if not both.any():
        raise FormatError(f"{called[1]}: has no point that {called[0]} has at the same time", remedy="shift")
    scale, how = 1.0, "not aligned"
    if align == "root":
        b, how = _by_root(a, b, names, called), "aligned by the root in every frame"
    elif align in ("rigid", "similarity"):
        b, scale = _align_rigidly(a, b, both, align == "similarity")
        how = "aligned by one rigid movement" + (f" and the scale {scale:.5g}" if align != "rigid" else "")
    distance = np.linalg.norm(a - b, axis=-1)
    return Comparison(names, distance, times, scale, how, _subject_notices(first, second, columns, called))


def _subject_notices(first: Any, second: Any, columns: list[list[int]], called: tuple[str, str]) -> tuple[str, ...]:
    """Whose landmarks were compared, where a file has several people's."""
    notices = (one_of_several(p.landmarks.names, used) for p, used in zip((first, second), columns, strict=True))
    return tuple(f"{name}: {one}" for name, one in zip(called, notices, strict=True) if one)


def _match(first: Any, second: Any, called: tuple[str, str]) -> tuple[tuple[str, ...], list[list[int]]]:
    """Names that both have, by spelling or by meaning, and the columns of each."""

    def exact(labels: tuple[str, ...]) -> dict[str, int]:
        return {n.strip().lower(): i for i, n in reversed(list(enumerate(labels)))}

    def plain(labels: tuple[str, ...]) -> dict[str, int]:
        return of_one_subject(labels, lambda mine: exact(tuple(n.rsplit(":", 1)[-1] for n in mine)))

    def roles(labels: tuple[str, ...]) -> dict[str, int]:
        return of_one_subject(labels, roles_of)

    best: tuple[tuple[str, ...], list[list[int]]] = ((), [[], []])
    # Landmarks that mean the same are at the same place; joints of the same role may have been put elsewhere.
    for by, enough in ((exact, 0.5), (plain, 0.5), (map_body, 0.2), (map_surface, 0.2), (roles, 0.0)):
        one, other = by(first.landmarks.names), by(second.landmarks.names)
        shared = tuple(n for n in one if n in other)
        if len(shared) > len(best[0]):
            best = shared, [[one[n] for n in shared], [other[n] for n in shared]]
            if len(shared) >= enough * min(len(first.landmarks), len(second.landmarks)):
                break
    if not best[0]:
        raise FormatError(
            f"{called[1]}: shares no landmark with {called[0]}: it has {', '.join(second.landmarks.names[:6])}, ...; "
            f"the other {', '.join(first.landmarks.names[:6])}, ...; rename one of them"
        )
    order = np.argsort(best[1][0])
    return tuple(best[0][i] for i in order), [[c[i] for i in order] for c in best[1]]


def _common_time(
    a: FloatArray, b: FloatArray, fps_a: float, fps_b: float, shift: float, called: tuple[str, str]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times of A's frames that B covers, and both there; B between its frames is interpolated, never across gaps."""
    times = np.arange(len(a)) / fps_a
    at = (times - shift) * fps_b
    inside = (at > -1e-6) & (at < len(b) - 1 + 1e-6)
    if not inside.any():
        raise FormatError(
            f"{called[1]}: its {len(b) / fps_b:.2f} s, shifted by {shift:g} s, do not overlap the "
            f"{len(a) / fps_a:.2f} s of {called[0]}",
            remedy="shift",
        )
    at = np.clip(at[inside], 0, len(b) - 1)
    low = np.floor(at + 1e-6).astype(np.intp)
    share = np.clip(at - low, 0.0, 1.0)[:, None, None]
    high = np.minimum(low + 1, len(b) - 1)
    between = np.where(share < 1e-3, b[low], (1 - share) * b[low] + share * b[high])
    return times[inside], a[inside], between


def _by_root(a: FloatArray, b: FloatArray, names: tuple[str, ...], called: tuple[str, str]) -> FloatArray:
    """`b` moved so that the roots coincide: the middle of the hips, or the hips' joint."""
    pairs = (("left_hip", "right_hip"), ("hips",), ("root",), ("left_thigh", "right_thigh"))
    for pair in pairs:
        if all(n in names for n in pair):
            columns = [names.index(n) for n in pair]
            return np.asarray(b + (a[:, columns] - b[:, columns]).mean(axis=1, keepdims=True))
    raise FormatError(f"{called[1]}: has no hips in common with {called[0]} to align the root by", remedy="align_rigid")


def _align_rigidly(a: FloatArray, b: FloatArray, both: BoolArray, with_scale: bool) -> tuple[FloatArray, float]:
    """`b` moved as a whole onto `a` by least squares (Kabsch; Umeyama with scale)."""
    p, q = a[both], b[both]
    middle_a, middle_b = p.mean(axis=0), q.mean(axis=0)
    turn = kabsch(q - middle_b, p - middle_a, np.ones(len(p)))
    turned = (q - middle_b) @ turn.T
    spread = float(np.sum(turned**2))
    scale = float(np.sum(turned * (p - middle_a))) / spread if with_scale and spread > 0 else 1.0
    return np.asarray(scale * (b - middle_b) @ turn.T + middle_a), scale


def _statistics(distance: FloatArray) -> tuple[float, float, float, float]:
    """Mean, median, 95th percentile and root mean square, in millimetres."""
    known = distance[np.isfinite(distance)] * 1e3
    if not known.size:
        return (float("nan"),) * 4
    middle, most = np.percentile(known, [50, 95])
    return float(known.mean()), float(middle), float(most), float(np.sqrt((known**2).mean()))


def format_table(found: Comparison) -> str:
    """A line of statistics per joint, and one of all joints."""
    width = max(5, *(len(n) for n in found.names))
    lines = [f"{'':<{width}}  {'mean':>8} {'median':>8} {'95 %':>8} {'RMS':>8}  mm  {'both known':>10}"]
    rows = [(name, found.distance_m[:, j]) for j, name in enumerate(found.names)]
    for name, distance in [*rows, ("all", found.distance_m)]:
        cells = " ".join(f"{v:8.1f}" if np.isfinite(v) else f"{'-':>8}" for v in _statistics(distance))
        lines.append(f"{name:<{width}}  {cells}      {np.isfinite(distance).mean():10.1%}")
    frames, seconds = len(found.times), found.times[-1] - found.times[0]
    lines.append(f"{len(found.names)} joints in common, {frames} frames over {seconds:.2f} s, {found.how}")
    return "\n".join(lines)


def write_plot(path: Path, found: Comparison, title: str) -> None:
    """Write a figure of the distances: per joint on the left, over time on the right.

    Raises:
        OutputError: the file cannot be written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    millimetres = found.distance_m * 1e3
    known = [millimetres[np.isfinite(millimetres[:, j]), j] for j in range(len(found.names))]
    figure = Figure(figsize=(12, max(4.0, 1.6 + 0.22 * len(found.names))), dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=(2, 3))
    place = np.arange(len(known))[::-1]
    mean = [float(k.mean()) if k.size else 0.0 for k in known]
    left.barh(place, mean, height=0.7, color="#6d94b8")
    for y, values in zip(place, known, strict=True):
        if values.size:
            low, middle, high = np.percentile(values, [5, 50, 95])
            left.plot([low, high], [y, y], color="#22384d", linewidth=1)
            left.plot(middle, y, marker="|", color="#22384d", markersize=7)
    left.set_yticks(place, [n.replace("_", " ") for n in found.names], fontsize=8)
    left.set_ylim(-0.7, len(known) - 0.3)
    left.set_xlim(left=0)
    left.set_xlabel("mm: mean (bar), median and 5 to 95 % (line)")
    counted = np.isfinite(millimetres)
    some = counted.any(axis=1)
    with np.errstate(invalid="ignore"):
        over_time = np.full((3, len(millimetres)), np.nan)
        over_time[:, some] = np.nanpercentile(millimetres[some], [10, 50, 90], axis=1)
    right.fill_between(found.times, over_time[0], over_time[2], color="#6d94b8", alpha=0.35, linewidth=0)
    right.plot(found.times, over_time[1], color="#22384d", linewidth=1.2, marker="." if len(found.times) < 3 else None)
    right.set_xlabel("seconds")
    right.set_ylabel("mm: median joint, and 10 to 90 % of the joints")
    top = float(np.nanmax(over_time[2]))
    usual = 1.6 * float(np.nanpercentile(over_time[2], 99)) + 1e-3
    right.set_ylim(0, min(1.05 * top + 1e-3, usual))
    if top > usual:
        worst = found.times[int(np.nanargmax(over_time[2]))]
        beyond = f"beyond: {top:.0f} mm at {worst:.2f} s"
        right.text(0.99, 0.98, beyond, transform=right.transAxes, ha="right", va="top")
    for axes in (left, right):
        axes.grid(axis="x" if axes is left else "y", color="#dddddd", linewidth=0.6)
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(f"{title}: mean {_statistics(found.distance_m)[0]:.1f} mm, {found.how}", fontsize=11)
    with replacing(path) as temporary:
        figure.savefig(temporary)
