"""Custom marker sets, as text files.

One marker per line: the laboratory's label, the point of the body that it is placed on (a name of `SURFACE`), and after
that, in any order, optional facts::

    # Our lab's leg set
    LASI  left_asis          mirror=RASI
    LTHI  left_thigh_distal  jitter=60    # mm, standard deviation: it is put anywhere on the thigh
    LMT5  left_metatarsal_5  optional

`mirror` names the twin on the other side (by default found by its body point), `jitter` the standard deviation of its
placement, `optional` marks that recordings may lack it, and `near` that it is beside its body point: it is recognised
by it, but no body is fitted to it. A set that was learned from a person also has distances between markers, in mm, and
how much they vary::

    distance LASI RASI 243.1 2.3
"""

import difflib
from pathlib import Path

import numpy as np

from muybridge.errors import FormatError, parsing
from muybridge.files import replacing
from muybridge.geometry.landmarks.marker_sets import (
    JITTER_MM,
    SETS,
    SURFACE,
    MarkerDistances,
    MarkerPlan,
    MarkerSet,
    plan_of,
    twins_of,
)

_MOST_LINES = 20_000


def find_marker_set(name: str) -> MarkerPlan:
    """A set by its name (`SETS`), or from a text file.

    Raises:
        FormatError: no set and no file of that name, or a file with a fault; the message names the line.
    """
    if name in SETS:
        return plan_of(SETS[name])
    path = Path(name)
    if path.is_file():
        return read_marker_set(path)
    near = difflib.get_close_matches(name, SETS, n=1)
    hint = f"did you mean {near[0]}?" if near else "or name a text file of your own (see docs/guides/label-markers.md)"
    raise FormatError(f"no marker set and no file {name!r}; known sets: {', '.join(SETS)}; {hint}")


def read_marker_set(path: Path) -> MarkerPlan:
    """A set of one's own; FormatError as `find_marker_set`."""
    with parsing(path, FormatError, "a marker set, a text file with one marker per line"):
        return _read(path)


def _read(path: Path) -> MarkerPlan:
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    if len(lines) > _MOST_LINES:
        raise FormatError(f"{path}: holds {len(lines)} lines; a marker set has at most {_MOST_LINES}")
    labels: list[str] = []
    names: list[str] = []
    jitter, optional, near, mirror = [], [], [], {}
    distances: list[tuple[int, list[str]]] = []
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].split()
        if not words:
            continue
        if words[0] == "distance" and len(words) != 2:
            distances.append((number, words))
            continue
        label, name, extra = _marker(path, number, words)
        if label in labels or name in names:
            raise FormatError(f"{path}: line {number}: {label if label in labels else name!r} appears twice; "
                              "a label and a body point may appear once")  # fmt: skip
        labels.append(label)
        names.append(name)
        jitter.append(_millimetres(path, number, "jitter", extra.get("jitter", str(JITTER_MM))) / 1000)
        optional.append("optional" in extra)
        near += [label] * ("near" in extra)
        mirror[label] = number, extra.get("mirror", "")
    if len(labels) < 6:
        raise FormatError(f"{path}: holds {len(labels)} markers; at least 6 are needed to recognise a person")
    for label, (number, twin) in mirror.items():
        if twin and twin not in labels:
            raise FormatError(f"{path}: line {number}: the mirror of {label}, {twin}, is not in the set")
    edges = tuple(e for e in SURFACE.edges if e[0] in names and e[1] in names)
    markers = MarkerSet(path.stem, tuple(names), edges, tuple(labels), tuple(near))
    twins = list(twins_of(markers))
    for label, (_, twin) in mirror.items():
        if twin:
            twins[labels.index(label)], twins[labels.index(twin)] = labels.index(twin), labels.index(label)
    known = _distances(path, labels, distances) if distances else None
    return MarkerPlan(markers, np.array(jitter), np.array(optional), tuple(twins), known)


def _distances(path: Path, labels: list[str], lines: list[tuple[int, list[str]]]) -> MarkerDistances:
    mean, sigma = np.full((len(labels),) * 2, np.nan), np.full((len(labels),) * 2, np.nan)
    for number, words in lines:
        if len(words) != 5:
            raise FormatError(f"{path}: line {number}: {len(words) - 1} words after `distance`; write two labels, the "
                              "distance and its spread in mm, such as: distance LASI RASI 243.1 2.3")  # fmt: skip
        for label in words[1:3]:
            if label not in labels:
                raise FormatError(f"{path}: line {number}: {label}, of a distance, is not in the set")
        a, b = (labels.index(label) for label in words[1:3])
        if a == b:
            raise FormatError(f"{path}: line {number}: a distance from {words[1]} to itself; name two markers")
        mean[a, b] = mean[b, a] = _millimetres(path, number, "the distance", words[3], 3000) / 1000
        sigma[a, b] = sigma[b, a] = _millimetres(path, number, "the spread", words[4]) / 1000
    return MarkerDistances(mean, sigma)


def _marker(path: Path, number: int, words: list[str]) -> tuple[str, str, dict[str, str]]:
    if len(words) < 2:
        raise FormatError(f"{path}: line {number}: {words[0]!r} is alone on its line; write a label and a body point")
    if words[1] not in SURFACE.names:
        near = difflib.get_close_matches(words[1], SURFACE.names, n=3, cutoff=0.4)
        raise FormatError(f"{path}: line {number}: no body point {words[1]!r}; near it are {', '.join(near) or 'none'}",
                          remedy="list_body_points")  # fmt: skip
    extra: dict[str, str] = {}
    for word in words[2:]:
        key, _, value = word.partition("=")
        if key not in ("mirror", "jitter", "optional", "near") or (key in ("mirror", "jitter")) != bool(value):
            raise FormatError(f"{path}: line {number}: {word!r} is not understood; valid are mirror=LABEL, jitter=MM, "
                              "optional, near")  # fmt: skip
        extra[key] = value
    return words[0], words[1], extra


def _millimetres(path: Path, number: int, what: str, text: str, most: float = 500) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 < value < most:
        said = f"{what}={text}" if what == "jitter" else f"{what}, {text},"
        raise FormatError(f"{path}: line {number}: {said} is no number of millimetres between 0 and {most:g}")
    return value


def marker_set_text(plan: MarkerPlan, comment: str = "") -> str:
    """A set as the text that `read_marker_set` reads."""
    lines = [f"# {comment}"] if comment else []
    wide = max(len(label) for label in plan.markers.labels)
    for i, (label, name) in enumerate(zip(plan.markers.labels, plan.markers.names, strict=True)):
        twin = plan.markers.labels[plan.twins[i]]
        words = [f"{label:<{wide}}", f"{name:<26}", f"jitter={plan.jitter_m[i] * 1000:.0f}"]
        words += [f"mirror={twin}"] * (twin != label) + ["optional"] * bool(plan.optional[i])
        lines.append("  ".join(words + ["near"] * (label in plan.markers.near)).rstrip())
    if plan.distances is not None:
        lines.append("# distances on the person, mm, and how much they vary: delete these lines for a set for anybody")
        mean, sigma = plan.distances.mean_m * 1000, plan.distances.sigma_m * 1000
        for a, b in zip(*np.nonzero(np.triu(np.isfinite(mean))), strict=True):
            pair = f"{plan.markers.labels[a]} {plan.markers.labels[b]}"
            lines.append(f"distance {pair} {max(mean[a, b], 0.1):.1f} {max(sigma[a, b], 0.1):.1f}")
    return "\n".join(lines)


def write_marker_set(path: Path, plan: MarkerPlan, comment: str = "") -> None:
    """A set as a text file."""
    with replacing(path) as temporary:
        temporary.write_text(marker_set_text(plan, comment) + "\n", encoding="utf-8", newline="\n")
