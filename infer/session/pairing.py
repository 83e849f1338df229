"""Pair videos with the cameras of a calibration, by name."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from muybridge.errors import SessionError


def _tokens(name: str) -> tuple[str, ...]:
    """Words and numbers of a name: `Take 2_cam01` -> take, 2, cam, 1."""
    return tuple(str(int(t)) if t.isdigit() else t for t in re.findall(r"\d+|[^\W\d_]+", name.lower()))


def _distinctive(names: Sequence[str]) -> list[tuple[str, ...]]:
    """Each name's tokens without the ones that all names begin or end with."""
    tokens = [_tokens(n) for n in names]
    if len(tokens) < 2:
        return tokens
    while all(tokens) and len({t[0] for t in tokens}) == 1:
        tokens = [t[1:] for t in tokens]
    while all(tokens) and len({t[-1] for t in tokens}) == 1:
        tokens = [t[:-1] for t in tokens]
    return tokens


def pair_by_name(stems: Sequence[str], names: Sequence[str]) -> dict[str, int]:
    """Camera name -> index of its video, by the strictest of four ways to compare names that pairs any.

    Names are the same; the same except for case, separators and leading zeros (`Cam 1`, `cam_01`); the camera's name
    is a part of the file's (`take2_cam01`) or the reverse; the distinguishing parts are the same (`Miqus_1` and
    `video1`). A way that pairs anything twice is not used.
    """

    def pairs(test: list[list[bool]]) -> dict[str, int]:
        table = np.asarray(test, dtype=bool).reshape(len(names), len(stems))
        if not table.any() or (table.sum(0) > 1).any() or (table.sum(1) > 1).any():
            return {}
        return {names[c]: int(np.argmax(row)) for c, row in enumerate(table) if row.any()}

    files, cameras = [_tokens(s) for s in stems], [_tokens(n) for n in names]
    file_parts, camera_parts = _distinctive(stems), _distinctive(names)
    readings = [
        [[s.lower() == n.lower() for s in stems] for n in names],
        [[f == c and bool(f) for f in files] for c in cameras],
        [[_within(c, f) or _within(f, c) for f in files] for c in cameras],
        [[f == c and bool(f) for f in file_parts] for c in camera_parts],
    ]
    best: dict[str, int] = {}
    for reading in readings:
        found = pairs(reading)
        if len(found) > len(best):
            best = found
    return best


def _within(part: tuple[str, ...], whole: tuple[str, ...]) -> bool:
    n = len(part)
    return n > 0 and any(whole[k : k + n] == part for k in range(len(whole) - n + 1))


def _numbers(names: Sequence[str]) -> list[int] | None:
    """The numbers of names that differ in one number only, such as cam0, cam1, cam2; None if they do not."""
    parts = _distinctive(names) if len(names) > 1 else []
    if not parts or any(len(p) != 1 or not p[0].isdigit() for p in parts):
        return None
    return [int(p[0]) for p in parts]


def numbered_otherwise(stems: Sequence[str], names: Sequence[str]) -> dict[str, str]:
    """Video -> camera in order, where one side counts from 0 and the other from 1 and both have as many; else empty.

    By name, each camera would be paired with its neighbour's video. The order may be wrong too, where another video and
    another camera are missing, so that nothing is paired before the user has renamed the videos.
    """
    videos, cameras = _numbers(stems), _numbers(names)
    if videos is None or cameras is None or len(videos) != len(cameras):
        return {}
    runs = all(sorted(n) == list(range(min(n), min(n) + len(n))) for n in (videos, cameras))
    if {min(videos), min(cameras)} != {0, 1} or not runs:
        return {}
    by_number = dict(zip(cameras, names, strict=True))
    return {stem: by_number[n - min(videos) + min(cameras)] for stem, n in zip(stems, videos, strict=True)}


def in_order(counted: dict[str, str]) -> str:
    """How to rename videos that are numbered otherwise than the cameras."""
    pairs = ", ".join(f"{stem} to {camera}" for stem, camera in counted.items())
    return f"one is counted from 0 and the other from 1: if they are in the same order, rename {pairs}"


def match_cameras(
    stems: Sequence[str], names: Sequence[str], session: Path, calibration: Path, no_pose: Sequence[str] = ()
) -> tuple[list[int], list[str]]:
    """The video of each camera.

    Args:
        stems: the videos' names without suffix, in natural order.
        names: the calibration's camera names.
        session: for messages.
        calibration: for messages.
        no_pose: names of cameras that the calibration has without a pose, for messages.

    Returns:
        For each camera the index of its video, and a notice unless the names are the same.

    Raises:
        SessionError: a camera has no video or a video no camera; the message names them.
    """
    paired = pair_by_name(stems, names)
    lonely_cameras = [n for n in names if n not in paired]
    lonely_videos = [s for k, s in enumerate(stems) if k not in paired.values()]
    if paired and not lonely_cameras and not lonely_videos:
        unlike = [(n, stems[k]) for n, k in paired.items() if n.lower() != stems[k].lower()]
        notices = [f"cameras and videos were paired by name: {_pairing(unlike)}"] if unlike else []
        return [paired[n] for n in names], notices
    if not paired and len(stems) == len(names):
        order = sorted(range(len(names)), key=lambda c: natural_key(names[c]))
        indices = [order.index(c) for c in range(len(names))]
        pairing = _pairing([(names[c], stems[indices[c]]) for c in range(len(names))])
        return indices, [
            f"no video has a camera's name, so they were paired in alphabetical order: {pairing}; "
            "rename the videos if that is wrong"
        ]
    problems = []
    if lonely_cameras:
        problems.append(f"{calibration} has no video for camera {', '.join(lonely_cameras)}")
    if lonely_videos:
        problems.append(f"{session / 'videos'} has no camera for video {', '.join(lonely_videos)}")
    if unposed := [n for n in no_pose if pair_by_name(lonely_videos, [n])]:
        problems.append(f"{calibration} does not say where {', '.join(unposed)} is")
    remedy = "name each video after its camera"
    if counted := numbered_otherwise(stems, names):
        remedy += f"; {in_order(counted)}"
    elif lonely_cameras and lonely_videos and _numbers(stems) and _numbers(names):
        # Whoever left out the cameras without a video might pair each of the others with its neighbour's video.
        remedy += ", in case the two are counted from different numbers"
    elif len(paired) >= 2:
        remedy += f", or choose the cameras with --cameras {' '.join(n for n in names if n in paired)}"
    raise SessionError(f"{' and '.join(problems)}; {remedy}")


def _pairing(pairs: Sequence[tuple[str, str]]) -> str:
    return ", ".join(f"{name} = {stem}" for name, stem in pairs)


def natural_key(text: str) -> tuple[tuple[int, int | str], ...]:
    """Sorting key under which `cam2` comes before `cam10`."""
    parts = re.findall(r"\d+|\D+", text.lower())
    return tuple((0, int(p)) if p.isdigit() else (1, p) for p in parts)
