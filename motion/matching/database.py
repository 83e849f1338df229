"""The takes that are matched: one after another, with the features of every frame and which frames may be found."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from muybridge.arrays import BoolArray, Float32Array, FloatArray, IndexArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.roles import RoleMap, find_motion_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.blending.material import same_skeleton
from muybridge.motion.editing.mirroring import mirror
from muybridge.motion.editing.root_path import GroundPath
from muybridge.motion.matching.features import (
    NEEDED_ROLES,
    FeatureOptions,
    Scaling,
    fit_scaling,
    motion_features,
    root_frames,
)
from muybridge.motion.matching.search import BoxTree

MIRRORED = "mirrored "  # before the name of a clip with left and right exchanged
_BEFORE = 2  # frames that a transition looks back in the clip that it goes to


@dataclass(frozen=True)
class Ignored:
    """A part of a clip that is not played.

    Attributes:
        clip: its name.
        start, end: seconds.
    """

    clip: str
    start: float
    end: float


@dataclass(frozen=True, eq=False)
class MatchDatabase:
    """Clips of one skeleton, for motion matching.

    Attributes:
        motion: (N frames) all clips, one after another.
        names: of the clips.
        starts: (clips + 1,) first frame of each clip, and N.
        path: facing frames of all frames; the yaw is the direction in the world that the body faces.
        features: (N, F) unscaled.
        ignored: (N,) frames in parts that are not played.
        roles: role -> joint.
        options: what is compared.
    """

    motion: Motion
    names: tuple[str, ...]
    starts: IndexArray
    path: GroundPath
    features: FloatArray
    ignored: BoolArray
    roles: Mapping[str, int]
    options: FeatureOptions = field(default_factory=FeatureOptions)

    def __len__(self) -> int:
        return len(self.motion)

    @property
    def fps(self) -> float:
        """Frames per second of all clips."""
        return self.motion.fps

    @cached_property
    def ends(self) -> IndexArray:
        """(N,) the frame behind the last one that may be played on to: the clip ends there, or a part to be ignored
        begins."""
        begins = np.flatnonzero(np.diff(self.ignored.astype(np.int8), prepend=0) > 0)
        stops = np.union1d(self.starts[1:], begins)
        return np.asarray(stops[np.searchsorted(stops, np.arange(len(self)), side="right")])

    @cached_property
    def searchable(self) -> BoolArray:
        """(N,) the frames that may be found: none in an ignored part, nor nearer to the end of what may be played than
        the longest horizon, since what goes on there is not known; nor the first two, before which no velocity is
        known."""
        frames = np.arange(len(self))
        behind = np.flatnonzero(np.diff(self.ignored.astype(np.int8), append=0) < 0) + 1
        begins = np.union1d(self.starts[:-1], behind)
        since = frames - begins[np.searchsorted(begins, frames, side="right") - 1]
        long = frames + horizon_frames(self.options, self.fps) < self.ends
        return np.asarray(long & (since >= _BEFORE) & ~self.ignored)

    @cached_property
    def scaling(self) -> Scaling:
        """Of the features, by the frames that may be found."""
        return fit_scaling(self.features[self.searchable], self.options)

    @cached_property
    def scaled(self) -> Float32Array:
        """(N, F) float32 scaled features."""
        return self.scaling.apply(self.features)

    @cached_property
    def tree(self) -> BoxTree:
        """Of the frames that may be found."""
        return BoxTree.build(self.scaled, self.searchable)

    def clip_of(self, frames: IndexArray | int) -> IndexArray:
        """The clips that frames are of."""
        return np.asarray(np.searchsorted(self.starts, frames, side="right") - 1)


@dataclass(frozen=True, eq=False)
class Built:
    """A database with what was assumed and passed over in making it, one sentence each."""

    database: MatchDatabase
    notices: tuple[str, ...]


def horizon_frames(options: FeatureOptions, fps: float) -> int:
    """Frames that a clip must go on for to be compared."""
    return int(np.ceil(options.horizons[-1] * fps - 1e-9))


def build_database(
    motions: Sequence[Motion], names: Sequence[str], options: FeatureOptions | None = None, *,
    fps: float | None = None, mirrored: bool = False, ignore: Sequence[Ignored] = (),
    role_map: RoleMap | None = None,
) -> Built:  # fmt: skip
    """Make a database of clips.

    Args:
        motions: Z up, of one skeleton.
        names: of the motions, each its own.
        options: what is compared.
        fps: frames per second of the database; None takes those of the first motion.
        mirrored: whether every clip is there a second time with left and right exchanged.
        ignore: parts of clips that are not played.
        role_map: of the skeleton; None finds it.

    Raises:
        MuybridgeError: there is no motion, names occur twice, skeletons differ, hips, thighs or feet are not known, no
            clip is long enough, or nothing of them is left to be found.
    """
    options = options or FeatureOptions()
    _check_names(motions, names)
    same, notices = same_skeleton(motions, names, fps)
    found = find_motion_roles(max(same, key=len)) if role_map is None else role_map
    found.require(names[0], NEEDED_ROLES)
    kept, kept_names = _long_enough(same, names, options, notices)
    if mirrored:
        kept_names = [*kept_names, *(MIRRORED + name for name in kept_names)]
        kept = [*kept, *(mirror(motion, roles=found.roles) for motion in kept)]
    starts = np.cumsum([0, *(len(motion) for motion in kept)])
    paths, _ = root_frames(kept, found.roles, options.smoothing)
    features = [motion_features(m, p, found.roles, options) for m, p in zip(kept, paths, strict=True)]
    database = MatchDatabase(
        joined(kept), tuple(kept_names), starts,
        GroundPath(np.concatenate([p.places for p in paths]), np.concatenate([p.yaw for p in paths])),
        np.concatenate(features), _ignored(ignore, list(names), kept_names, starts, kept[0].fps), found.roles, options,
    )  # fmt: skip
    if not database.searchable.any():
        raise MuybridgeError("nothing of the clips is left that may be found: every frame is in a part to be ignored")
    return Built(database, (*notices, *found.notes))


def joined(motions: Sequence[Motion]) -> Motion:
    """(N frames) motions of one skeleton one after another, as they are."""
    first = motions[0]
    slides = None
    if first.translations is not None:
        slides = np.concatenate([m.translations for m in motions if m.translations is not None])
    return Motion(
        first.skeleton, first.fps, np.concatenate([m.root_positions_world for m in motions]),
        np.concatenate([m.quat_wxyz for m in motions]), slides,
    )  # fmt: skip


def _check_names(motions: Sequence[Motion], names: Sequence[str]) -> None:
    if not motions:
        raise MuybridgeError("there is no clip to be matched; give at least one")
    if len(motions) != len(names):
        raise ValueError(f"{len(motions)} motions cannot have {len(names)} names")
    twice = [name for name in names if list(names).count(name) > 1]
    if twice:
        raise MuybridgeError(f"two clips are called {twice[0]!r}; give each a name of its own")


def _long_enough(
    motions: Sequence[Motion], names: Sequence[str], options: FeatureOptions, notices: list[str]
) -> tuple[list[Motion], list[str]]:
    """The clips of which a frame could be found, with their names; a notice on each of the others.

    Raises:
        MuybridgeError: there is none.
    """
    least = horizon_frames(options, motions[0].fps) + _BEFORE + 1
    kept = [k for k, motion in enumerate(motions) if len(motion) >= least]
    if not kept:
        longest = max(range(len(motions)), key=lambda k: len(motions[k]))
        raise MuybridgeError(
            f"no clip is long enough: {least} frames are needed at {motions[0].fps:g} frames/s, since frames are "
            f"compared by where the body goes in the next {options.horizons[-1]:g} s, and the longest, "
            f"{names[longest]}, has {len(motions[longest])}; give longer clips or shorter horizons"
        )
    for k, motion in enumerate(motions):
        if k not in kept:
            notices.append(f"{names[k]} is left out: it has {len(motion)} of the {least} frames that are needed")
    return [motions[k] for k in kept], [names[k] for k in kept]


def _ignored(
    ignore: Sequence[Ignored], given: list[str], names: Sequence[str], starts: IndexArray, fps: float
) -> BoolArray:
    """(N,) the frames in parts to be ignored; those of a clip are those of its mirror image too."""
    out = np.zeros(starts[-1], np.bool_)
    for part in ignore:
        if part.clip not in given:
            raise MuybridgeError(
                f"there is no clip {part.clip!r} to ignore a part of; the clips are {', '.join(given)}"
            )
        if not 0 <= part.start < part.end:
            raise MuybridgeError(
                f"the part of {part.clip} to be ignored must end after it starts, not go from {part.start:g} to "
                f"{part.end:g} s"
            )
        for k, name in enumerate(names):
            if name.removeprefix(MIRRORED) == part.clip:
                first = starts[k] + int(np.ceil(part.start * fps - 1e-9))
                behind = starts[k] + int(min(np.floor(part.end * fps + 1e-9) + 1, starts[k + 1] - starts[k]))
                out[first:behind] = True
    return out
