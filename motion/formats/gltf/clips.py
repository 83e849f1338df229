"""The animations of a glTF file, and their values at any time.

Source: Khronos Group, glTF 2.0 Specification, section 3.11 and appendix C (interpolation).
"""

from collections.abc import Container
from dataclasses import dataclass

import numpy as np
import scipy

from muybridge.arrays import FloatArray
from muybridge.motion.formats.gltf.container import Document
from muybridge.motion.formats.skeletal.joint_frames import different_names, frame_times

_DEFAULT_FPS = 30.0
_SPARSE_FPS = 12.0  # keys that lie farther apart were set by hand and are no frames


@dataclass
class Track:
    """Keys of one property of one node.

    Attributes:
        times: (N,) seconds, ascending.
        values: (N, 1, K); (N, 3, K) for cubic splines: tangent in, value, tangent out.
        kind: LINEAR, STEP or CUBICSPLINE.
    """

    times: FloatArray
    values: FloatArray
    kind: str


Tracks = dict[tuple[int, str], Track]


def clip_names_of(document: Document) -> tuple[str, ...]:
    """The animations' names in the file's order, no two the same; unnamed ones are `animation_<number>`."""
    animations = document.json.get("animations") or []
    return different_names([str(a.get("name") or f"animation_{i}") for i, a in enumerate(animations)])


def read_tracks(document: Document, clip: int | None, nodes: Container[int]) -> Tracks:
    """The tracks of a clip for some nodes, by node and property.

    Raises:
        FormatError: keys that do not fit together.
    """
    if clip is None:
        return {}
    chosen = document.json["animations"][clip]
    out: Tracks = {}
    for channel in chosen["channels"]:
        node, what = channel["target"].get("node"), channel["target"]["path"]
        if node not in nodes or what not in ("translation", "rotation", "scale"):
            continue
        sampler = chosen["samplers"][channel["sampler"]]
        kind = sampler.get("interpolation", "LINEAR")
        times, values = document.accessor(sampler["input"])[:, 0], document.accessor(sampler["output"])
        width = 4 if what == "rotation" else 3
        keys = len(times) * (3 if kind == "CUBICSPLINE" else 1)
        if not len(times) or values.shape != (keys, width) or (np.diff(times) <= 0).any():
            raise document.error(f"the animation of node {node}'s {what} has keys that do not fit together")
        out[node, what] = Track(times, values.reshape(len(times), -1, width), kind)
    return out


def even_times(document: Document, tracks: Tracks, clip: int | None) -> tuple[float, FloatArray]:
    """Frames per second, and (T,) seconds of the frames from the first key to the last.

    The rate is the one that our own files state, else that of the track with most keys. Keys that are too sparse to be
    frames are sampled at the lowest multiple of their rate that is at least 30.
    """
    if not tracks or clip is None:
        return _DEFAULT_FPS, np.zeros(1)
    first = min(t.times[0] for t in tracks.values())
    last = max(t.times[-1] for t in tracks.values())
    finest = max((t.times for t in tracks.values()), key=len)
    extras = document.json["animations"][clip].get("extras")
    stated = extras.get("fps") if isinstance(extras, dict) else None
    if isinstance(stated, int | float) and 0 < stated < 1e6:
        fps = float(stated)
    else:
        # Keys may lie on part of the frames only: the step that most of them have.
        fps = float(1.0 / np.median(np.diff(finest))) if len(finest) > 1 else _DEFAULT_FPS
        fps *= np.ceil(_DEFAULT_FPS / fps - 1e-3) if fps < _SPARSE_FPS else 1.0
        fps = float(round(fps)) if abs(fps - round(fps)) < 1e-2 else fps
    return fps, frame_times(first, last, fps, sum(len(t.times) for t in tracks.values()), document.error)


def sample(track: Track, times: FloatArray, rotation: bool) -> FloatArray:
    """(T, K) values of a track, constant before its first and after its last key. Rotations (xyzw) are normalised."""
    keys = track.times
    at = np.clip(times, keys[0], keys[-1])
    if track.kind == "CUBICSPLINE":
        out = _cubic(track, at)
    elif len(keys) == 1 or track.kind == "STEP":
        # Times are single precision in the file: a key counts from a little before it.
        k = np.searchsorted(keys, at + 1e-6 * max(1.0, abs(keys[-1])), side="right") - 1
        out = track.values[np.maximum(k, 0), 0]
    elif rotation:
        turns = scipy.spatial.transform.Rotation.from_quat(track.values[:, 0])
        return np.asarray(scipy.spatial.transform.Slerp(keys, turns)(at).as_quat())
    else:
        out = np.stack([np.interp(at, keys, track.values[:, 0, c]) for c in range(track.values.shape[-1])], axis=-1)
    if rotation:
        out = out / np.maximum(np.linalg.norm(out, axis=-1, keepdims=True), 1e-12)
    return np.asarray(out)


def _cubic(track: Track, at: FloatArray) -> FloatArray:
    """Hermite splines, as the specification's appendix C has them."""
    keys = track.times
    if len(keys) == 1:
        return np.repeat(track.values[:, 1], len(at), axis=0)
    k = np.clip(np.searchsorted(keys, at, side="right") - 1, 0, len(keys) - 2)
    step = (keys[k + 1] - keys[k])[:, None]
    s = (at - keys[k])[:, None] / step
    start, end = track.values[k], track.values[k + 1]
    return np.asarray(
        (2 * s**3 - 3 * s**2 + 1) * start[:, 1]
        + step * (s**3 - 2 * s**2 + s) * start[:, 2]
        + (3 * s**2 - 2 * s**3) * end[:, 1]
        + step * (s**3 - s**2) * end[:, 0]
    )
