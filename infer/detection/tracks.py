"""2D landmarks by landmark set: of single crops, of one camera's video, and of all cameras together.

A network may find several sets at once (the body's landmarks, virtual markers on the skin). Each set has the same
arrays, so results map a set's name to them: `tracks.landmarks["body23"]`, `tracks.landmarks["surface"]`. The first
entry is the body's, which detection and tracking work with.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.landmarks.sets import LandmarkSet

# What arrays hold where there is nothing; NaN in those that are not named.
_MISSING = {"score": 0.0, "visibility": 0.0, "ids": -1}
_FIELDS = ("points_px", "variance_px2", "score", "visibility")

Change = Callable[[str, NDArray[Any]], NDArray[Any]]


def missing_value(field: str) -> float:
    """The value of an array of this name where nothing was found."""
    return _MISSING.get(field, np.nan)


@dataclass(frozen=True, eq=False)
class LandmarkArrays:
    """The landmarks of one set; the leading axes are frames and people (T, P), or single poses (K,).

    Attributes:
        set: the meaning of the `J` axis.
        points_px: (..., J, 2) px of the video; NaN where missing.
        variance_px2: (..., J) variance of each coordinate; NaN where missing.
        score: (..., J) confidence in 0..1, zero where missing.
        visibility: (..., J) probability that the landmark is not hidden, zero where missing; None where the network
            does not tell.
    """

    set: LandmarkSet
    points_px: FloatArray
    variance_px2: FloatArray
    score: FloatArray
    visibility: FloatArray | None = None

    def arrays(self) -> dict[str, FloatArray]:
        """The arrays by name, without a copy."""
        named = {name: getattr(self, name) for name in _FIELDS}
        return {name: array for name, array in named.items() if array is not None}

    def map(self, change: Change) -> LandmarkArrays:
        """The same with every array replaced by `change(name, array)`."""
        changed: dict[str, Any] = {name: change(name, array) for name, array in self.arrays().items()}
        return replace(self, **changed)


@dataclass(frozen=True, eq=False)
class CameraTracks:
    """Landmarks of the people in one camera's video; a slot `p` is one track (see `Keypoints2D`).

    Attributes:
        landmarks: (T, P, J, ...) arrays by the name of their set, the body's first.
        boxes_px: (T, P, 4) left, top, right, bottom of the box that was cropped; NaN where there was none.
        ids: (T, P) number of the track, -1 where there is none. A slot may hold several, one after another.
    """

    landmarks: Mapping[str, LandmarkArrays]
    boxes_px: FloatArray
    ids: IntArray

    @property
    def body(self) -> LandmarkArrays:
        """The body's landmarks."""
        return body_of(self.landmarks)

    @property
    def frames(self) -> int:
        """T."""
        return len(self.ids)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """All arrays, without a copy: `boxes_px`, `ids` and, for each set, `body23.points_px` and so on."""
        return {"boxes_px": self.boxes_px, "ids": self.ids, **flat(self.landmarks)}

    def map(self, change: Change) -> CameraTracks:
        """The same with every array replaced by `change(name, array)`; names are those of fields, without the set."""
        landmarks = {name: arrays.map(change) for name, arrays in self.landmarks.items()}
        return CameraTracks(landmarks, change("boxes_px", self.boxes_px), change("ids", self.ids))


def body_of(landmarks: Mapping[str, LandmarkArrays]) -> LandmarkArrays:
    """The body's landmarks, which come first."""
    return next(iter(landmarks.values()))


def by_name(sets: Iterable[LandmarkArrays]) -> dict[str, LandmarkArrays]:
    """Arrays of several sets by the sets' names, in their order."""
    return {arrays.set.name: arrays for arrays in sets}


def flat(landmarks: Mapping[str, LandmarkArrays]) -> dict[str, NDArray[Any]]:
    """The arrays of all sets as `set.field`, without a copy."""
    return {f"{name}.{field}": a for name, arrays in landmarks.items() for field, a in arrays.arrays().items()}


def unflat(arrays: Mapping[str, NDArray[Any]], sets: Sequence[LandmarkSet]) -> dict[str, LandmarkArrays]:
    """The inverse of `flat`: those of `sets` that `arrays` has, in the order of `sets`."""
    found = []
    for each in sets:
        own = {field: arrays[name] for field in _FIELDS if (name := f"{each.name}.{field}") in arrays}
        if own:
            found.append(LandmarkArrays(each, **own))
    return by_name(found)


def tracks_from(arrays: Mapping[str, NDArray[Any]], sets: Sequence[LandmarkSet]) -> CameraTracks:
    """The tracks whose `CameraTracks.arrays` these are; other arrays among them are passed over.

    Args:
        arrays: by name.
        sets: landmark sets that they may be of, the body's first.
    """
    return CameraTracks(unflat(arrays, sets), arrays["boxes_px"], arrays["ids"])


def first_frames(tracks: CameraTracks, frames: int) -> CameraTracks:
    """The tracks in the first `frames` frames."""
    return tracks if tracks.frames == frames else tracks.map(lambda _, array: array[:frames])


def with_rest(tracks: CameraTracks, frames: int) -> CameraTracks:
    """The tracks with so many more frames at the end, with nobody in them."""
    if not frames:
        return tracks

    def longer(name: str, array: NDArray[Any]) -> NDArray[Any]:
        return np.concatenate([array, np.full((frames, *array.shape[1:]), missing_value(name), dtype=array.dtype)])

    return tracks.map(longer)


def without_frames(tracks: CameraTracks, frames: BoolArray) -> CameraTracks:
    """The tracks with nobody in the true ones of (T,) frames."""
    if not frames.any():
        return tracks

    def emptied(name: str, array: NDArray[Any]) -> NDArray[Any]:
        return np.where(frames.reshape(-1, *[1] * (array.ndim - 1)), missing_value(name), array).astype(array.dtype)

    return tracks.map(emptied)


def merge_tracks(tracks: Sequence[CameraTracks]) -> dict[str, Keypoints2D]:
    """The cameras' tracks as one set of arrays per landmark set, slots padded to the most that a camera has.

    Returns:
        by the set's name, the body first; sets that every camera has.

    Raises:
        ValueError: no camera, or numbers of frames or landmarks that differ.
    """
    if not tracks:
        raise ValueError("no camera's tracks to merge")
    frames = sorted({t.frames for t in tracks})
    if len(frames) > 1 or any(t.body.set != tracks[0].body.set for t in tracks):
        raise ValueError(f"the cameras differ in frames ({frames}) or landmarks")
    return {
        name: Keypoints2D(
            landmarks=arrays.set,
            points_px=_padded("points_px", [t.landmarks[name].points_px for t in tracks]),
            variance_px2=_padded("variance_px2", [t.landmarks[name].variance_px2 for t in tracks]),
            score=_padded("score", [t.landmarks[name].score for t in tracks]),
        )
        for name, arrays in tracks[0].landmarks.items()
        if all(name in t.landmarks for t in tracks)
    }


def with_slots(field: str, array: NDArray[Any], slots: int) -> NDArray[Any]:
    """(T, slots, ...): an array (T, P, ...) of this field's name with empty slots added."""
    result = np.full((len(array), slots, *array.shape[2:]), missing_value(field), dtype=array.dtype)
    result[:, : array.shape[1]] = array
    return result


def _padded(field: str, parts: list[FloatArray]) -> FloatArray:
    """(C, T, P, ...) of the cameras' (T, p, ...), p padded to the most that one has."""
    slots = max(part.shape[1] for part in parts)
    return np.stack([with_slots(field, part, slots) for part in parts])
