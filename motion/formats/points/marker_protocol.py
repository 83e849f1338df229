"""Custom marker sets, as text files.

One marker per line: the laboratory's label, the point of the body that it is placed on (a name of `SURFACE`), and after
that, in any order, optional facts::

    # Our lab's leg set
    LASI  left_asis          mirror=RASI
    LTHI  left_thigh_distal  jitter=60    # mm, standard deviation: it is put anywhere on the thigh
    LMT5  left_metatarsal_5  optional

`mirror` names the twin on the other side (by default found by its body point), `jitter` the standard deviation of its
placement, and `optional` marks that recordings may lack it.
"""

import difflib
from pathlib import Path

import numpy as np

from muybridge.errors import FormatError
from muybridge.files import replacing
from muybridge.geometry.landmarks.marker_sets import JITTER_MM, SETS, SURFACE, MarkerPlan, MarkerSet, plan_of, twins_of


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
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise FormatError(f"{path}: cannot be read as text ({error}); write one marker per line") from error
    labels: list[str] = []
    names: list[str] = []
    jitter, optional, mirror = [], [], {}
    for number, line in enumerate(lines, 1):
        words = line.split("#")[0].split()
        if not words:
            continue
        label, name, extra = _marker(path, number, words)
        if label in labels or name in names:
            raise FormatError(f"{path}: line {number}: {label if label in labels else name!r} appears twice; "
                              "a label and a body point may appear once")  # fmt: skip
        labels.append(label)
        names.append(name)
        jitter.append(_millimetres(path, number, extra.get("jitter", str(JITTER_MM))) / 1000)
        optional.append("optional" in extra)
        mirror[label] = extra.get("mirror", "")
    if len(labels) < 6:
        raise FormatError(f"{path}: holds {len(labels)} markers; at least 6 are needed to recognise a person")
    lost = [(a, b) for a, b in mirror.items() if b and b not in labels]
    if lost:
        raise FormatError(f"{path}: the mirror of {lost[0][0]}, {lost[0][1]}, is not in the set")
    edges = tuple(e for e in SURFACE.edges if e[0] in names and e[1] in names)
    markers = MarkerSet(path.stem, tuple(names), edges, tuple(labels))
    twins = list(twins_of(markers))
    for a, b in mirror.items():
        if b:
            twins[labels.index(a)], twins[labels.index(b)] = labels.index(b), labels.index(a)
    return MarkerPlan(markers, np.array(jitter), np.array(optional), tuple(twins))


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
        if key not in ("mirror", "jitter", "optional") or (key != "optional" and not value):
            raise FormatError(f"{path}: line {number}: {word!r} is not understood; valid are mirror=LABEL, jitter=MM, "
                              "optional")  # fmt: skip
        extra[key] = value
    return words[0], words[1], extra


def _millimetres(path: Path, number: int, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 < value < 500:
        raise FormatError(f"{path}: line {number}: jitter={text} is no number of millimetres between 0 and 500")
    return value


def marker_set_text(plan: MarkerPlan, comment: str = "") -> str:
    """A set as the text that `read_marker_set` reads."""
    lines = [f"# {comment}"] if comment else []
    wide = max(len(label) for label in plan.markers.labels)
    for i, (label, name) in enumerate(zip(plan.markers.labels, plan.markers.names, strict=True)):
        twin = plan.markers.labels[plan.twins[i]]
        words = [f"{label:<{wide}}", f"{name:<26}", f"jitter={plan.jitter_m[i] * 1000:.0f}"]
        words += [f"mirror={twin}"] * (twin != label) + ["optional"] * bool(plan.optional[i])
        lines.append("  ".join(words))
    return "\n".join(lines)


def write_marker_set(path: Path, plan: MarkerPlan, comment: str = "") -> None:
    """A set as a text file."""
    with replacing(path) as temporary:
        temporary.write_text(marker_set_text(plan, comment) + "\n", encoding="utf-8", newline="\n")
