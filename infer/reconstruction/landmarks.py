"""From the cameras' 2D landmarks to one person's motion: the stages that need no video."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, FloatArray, IntArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.association.options import TrackingOptions
from muybridge.geometry.association.select import select_person, take_slots
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.fitting.body_fit import FitOptions, fit_body, landmarks_from_motion
from muybridge.geometry.landmarks.arrays import Keypoints2D, Points3D
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.geometry.smoothing.kalman import SmoothOptions, smooth_points
from muybridge.geometry.triangulation.left_right import FlipOptions, repair_flips
from muybridge.geometry.triangulation.multiview import TriangulateOptions, triangulate
from muybridge.geometry.triangulation.plausibility import stretched_limbs, uncertain_points
from muybridge.geometry.triangulation.shape_prior import PosePriorOptions, with_pose_prior
from muybridge.geometry.triangulation.validation import leave_one_out_error
from muybridge.geometry.triangulation.view_bias import ViewBiasOptions, learn_view_bias, without_view_bias
from muybridge.infer.detection.refine import RefinedTake, TopDownRefinement
from muybridge.infer.reconstruction.virtual_markers import triangulate_markers
from muybridge.infer.runtime.digests import code_digest, digest
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import StageResult, StageStore

# Appended to the names of stages that follow a second look.
_AGAIN = ", second look"
# Landmarks measured in at least this share of the frames may be taken from the fitted body where they are not.
_NOW_AND_THEN = 0.2
# And of these a camera has to be sure in this share.
_MOSTLY_SURE = 0.5

Arrays = Mapping[str, NDArray[Any]]


# Of people seen whole our network's surest camera is nearly always over 0.8, of what no picture shows at 0.1 to 0.5.
MIN_CONFIDENCE = 0.5


@dataclass(frozen=True)
class SolveOptions:
    """How 2D landmarks become motion.

    Attributes:
        tracking: which person is tracked.
        flips: left and right, where one camera has exchanged them.
        triangulate: 3D points.
        view_bias: where the network puts a landmark from this side and from that.
        pose_prior: what the rest of the body and of the take say about a point.
        smooth: points over time.
        fit: the skeleton and its joint angles.
        min_confidence: a landmark of which no camera is as sure as this, in 0..1, is not taken for measured: people of
            whom all cameras have a part alone are not made whole. 0 to take every guess; None for what the network's
            card says, which is `MIN_CONFIDENCE` for ours.
        fill_share: a landmark that the cameras do not agree on is taken from the fitted body in frames where at
            least this share of the landmarks was measured; above 1, never.
        everyone: follow the other people too.
    """

    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    flips: FlipOptions = field(default_factory=FlipOptions)
    triangulate: TriangulateOptions = field(default_factory=TriangulateOptions)
    view_bias: ViewBiasOptions = field(default_factory=ViewBiasOptions)
    pose_prior: PosePriorOptions = field(default_factory=PosePriorOptions)
    smooth: SmoothOptions = field(default_factory=SmoothOptions)
    fit: FitOptions = field(default_factory=FitOptions)
    min_confidence: float | None = None
    fill_share: float = 0.5
    everyone: bool = False

    def __post_init__(self) -> None:
        if self.min_confidence is not None and not 0 <= self.min_confidence <= 1:
            raise ValueError(f"min_confidence is {self.min_confidence:g}: a score from 0 to 1")

    @property
    def confident_from(self) -> float:
        """The score from which a landmark counts as seen."""
        return MIN_CONFIDENCE if self.min_confidence is None else self.min_confidence

    def with_card(self, min_confidence: float | None) -> SolveOptions:
        """The same, with what the network's card says of its scores where nothing else was asked for."""
        return self if self.min_confidence is not None else replace(self, min_confidence=min_confidence)


@dataclass(frozen=True)
class Solution:
    """What was made of a take.

    Attributes:
        person: one sentence: who was followed, and why.
        points_px: (C, T, J, 2) the person's 2D landmarks, left and right put back; NaN where missing.
        variance_px2: (C, T, J).
        measured: the triangulated points.
        unsure: (T, J) where cameras have a landmark and none is sure of it; there it is not measured.
        points: the same, smoothed, with gaps filled.
        flipped: (C, T, J) where left and right were put back.
        leave_one_out_px: (C, T, J) see `geometry.triangulation.leave_one_out_error`.
        noise_px: noise that the take shows beyond the network's own variance.
        motion: the fitted skeleton; None where the points did not suffice for one.
        no_motion: why there is none.
        markers: virtual markers on the skin, smoothed; None where they were not asked for.
        stages: the stages by name, in order, for their timings.
        others: the other people whom two cameras see, where everyone was asked for; they have no others.
    """

    person: str
    points_px: FloatArray
    variance_px2: FloatArray
    measured: Points3D
    unsure: BoolArray
    points: Points3D
    flipped: BoolArray
    leave_one_out_px: FloatArray
    noise_px: float
    motion: Motion | None
    no_motion: str
    markers: Points3D | None
    stages: dict[str, StageResult]
    others: tuple[Solution, ...] = ()


def solve(
    cameras: CameraGroup,
    keypoints: Keypoints2D,
    fps: float,
    inputs: str,
    store: StageStore,
    options: SolveOptions,
    progress: Progress,
    markers: Keypoints2D | None = None,
    look_again: TopDownRefinement | None = None,
) -> Solution:
    """Follow the person of interest through the take, or everyone.

    Args:
        cameras: C cameras, as the videos are.
        keypoints: everyone who was found.
        fps: frames a second.
        inputs: digest of what the keypoints were made from.
        store: where finished stages are.
        options: how.
        progress: whom to tell.
        markers: the same people's virtual markers, in the same slots.
        look_again: reads the views of a person again once they are known in 3D.
    """
    stage = _Stages(store, progress, [inputs, code_digest("muybridge.geometry", "muybridge.infer.reconstruction"), fps])
    person = stage("person", options.tracking, lambda: _select(cameras, keypoints, options.tracking, fps))
    take = _Take(stage, cameras, keypoints, markers, fps, options)
    main = _followed(take, "", person, look_again)
    if not options.everyone:
        several = len(person.arrays["others"]) > 0
        return replace(main, person=f"{main.person}; --everyone writes them too") if several else main
    others = []
    for n, slots in enumerate(person.arrays["others"], start=2):
        one = stage(f"person {n}", person.key, partial(_further, keypoints, slots))
        others.append(_followed(take, f" {n}", one, look_again))
    files = "; each further person whom two cameras see has files of their own" if others else ""
    return replace(main, person=main.person + files, others=tuple(others))


@dataclass(frozen=True)
class _Take:
    """What is the same for everyone in a take."""

    stage: _Stages
    cameras: CameraGroup
    keypoints: Keypoints2D
    markers: Keypoints2D | None
    fps: float
    options: SolveOptions


class _Read(NamedTuple):
    """What the cameras have of one person: the take, with a second look's landmarks where there was one, and the stages
    of the person's landmarks, of their sides and of the triangulated points."""

    take: _Take
    person: StageResult
    sides: StageResult
    cloud: StageResult
    again: RefinedTake | None = None


def _read(take: _Take, number: str, person: StageResult, look_again: TopDownRefinement | None) -> _Read:
    """One person's 2D landmarks, looked for again where the first 3D points are, and triangulated."""
    sides, cloud = _to_points(take, number, person)
    if look_again is None:
        return _Read(take, person, sides, cloud)
    measured = _as_points(take.keypoints.landmarks, cloud.arrays, take.fps)
    # Not as the result is smoothed: another cut-off for that needs no other look.
    expected = smooth_points(measured, SmoothOptions())
    again = look_again(person.arrays["slots"], measured, expected, number.replace(" ", "-"))
    if again is None:
        return _Read(take, person, sides, cloud)
    take.stage.done |= again.stages
    take, reason = replace(take, keypoints=again.keypoints, markers=again.markers), str(person.facts["reason"])
    person = take.stage(
        f"person{number}{_AGAIN}", [person.key, [s.key for s in again.stages.values()]],
        lambda: (_taken(again.keypoints, again.slots), {"reason": reason}),
    )  # fmt: skip
    return _Read(take, person, *_to_points(take, number + _AGAIN, person), again)


def _followed(take: _Take, number: str, person: StageResult, look_again: TopDownRefinement | None) -> Solution:
    """One person from 2D landmarks to motion; `number` is appended to the names of the stages."""
    take, person, sides, cloud, again = _read(take, number, person, look_again)
    stage, cameras, keypoints, markers, fps, options = (getattr(take, f.name) for f in fields(take))
    sure = _sure(person.arrays["score"], sides.arrays["flipped"], keypoints.landmarks, options.confident_from)
    unsure = ~sure & np.isfinite(cloud.arrays["points_world"]).all(-1)
    measured = _as_points(keypoints.landmarks, _only(cloud.arrays, sure), fps)

    def alone() -> Arrays:
        # Views that were told what the others see agree with them: each has to be asked on its own.
        if again is None:
            return sides.arrays
        return _sides(cameras, again.alone, _taken(again.alone, again.slots), options.flips)[0]

    left_out = stage(
        f"left out{number}", [person.key, options.flips, options.triangulate],
        lambda: _left_out(cameras, alone(), options.triangulate),
    )  # fmt: skip
    px, variance = sides.arrays["points_px"], sides.arrays["variance_px2"]
    given = [cloud.key, options.confident_from]
    smooth = stage(f"smooth{number}", [*given, options.smooth], lambda: _smooth(measured, options.smooth))
    points = replace(measured, **smooth.arrays)
    motion, no_motion = None, ""
    try:
        fitted = stage(f"motion{number}", [*given, options.fit], lambda: _fit(measured, options.fit))
        motion = _unpack(fitted)
        points = _filled(points, measured, sure, fitted.arrays, options.fill_share)
    except MuybridgeError as error:
        # The points and the pictures show what is wrong: they are worth having without a motion.
        no_motion = str(error)
    marked = None
    if markers is not None:
        skin = stage(
            f"markers{number}",
            [person.key, options.flips, options.triangulate, options.confident_from],
            lambda: _markers(cameras, person.arrays, keypoints.landmarks, markers, options),
        )
        marked = smooth_points(_as_points(markers.landmarks, skin.arrays, fps), options.smooth)
    return Solution(
        person=str(person.facts["reason"]),
        points_px=px,
        variance_px2=variance,
        measured=measured,
        unsure=unsure,
        points=points,
        flipped=sides.arrays["flipped"],
        leave_one_out_px=left_out.arrays["leave_one_out_px"],
        noise_px=float(cloud.facts["noise_px"]),
        motion=motion,
        no_motion=no_motion,
        markers=marked,
        stages=stage.done,
    )


class _Stages:
    """Computes stages, or takes them from the store."""

    def __init__(self, store: StageStore, progress: Progress, inputs: Sequence[Any]):
        """`inputs`: what all stages depend on."""
        self._store, self._progress, self._inputs = store, progress, inputs
        self.done: dict[str, StageResult] = {}

    def __call__(self, name: str, given: Any, compute: Callable[[], tuple[Arrays, Mapping[str, Any]]]) -> StageResult:
        """The stage `name`, which depends on `given` besides."""
        key = digest(name, self._inputs, given)
        result = self._store.load(name, key)
        if result is not None:
            self._progress.say(f"{name}: resumed from {self._store.folder / (name + '.npz')}")
        else:
            self._progress.stage(name)
            start = time.perf_counter()
            arrays, facts = compute()
            result = self._store.save(name, key, arrays, facts, time.perf_counter() - start)
            self._progress.say(f"{name}: {result.seconds:.1f} s")
        self.done[name] = result
        return result


def _to_points(take: _Take, suffix: str, person: StageResult) -> tuple[StageResult, StageResult]:
    """The person's landmarks with the sides put back, and triangulated."""
    stage, cameras, options, landmarks = take.stage, take.cameras, take.options, take.keypoints.landmarks
    sides = stage(
        f"sides{suffix}", [person.key, options.flips],
        lambda: _sides(cameras, take.keypoints, person.arrays, options.flips),
    )  # fmt: skip
    px, variance = sides.arrays["points_px"], sides.arrays["variance_px2"]
    cloud = stage(
        f"points{suffix}", [sides.key, options.triangulate, options.view_bias, options.pose_prior],
        lambda: _points(cameras, px, variance, landmarks, take.fps, options),
    )  # fmt: skip
    return sides, cloud


def _taken(keypoints: Keypoints2D, slots: IntArray) -> Arrays:
    """The landmarks in the slots (C, T) of one person."""
    points_px, variance_px2, score = take_slots(keypoints, slots)
    return {"slots": slots, "points_px": points_px, "variance_px2": variance_px2, "score": score}


def _further(keypoints: Keypoints2D, slots: IntArray) -> tuple[Arrays, dict[str, Any]]:
    return _taken(keypoints, slots), {"reason": ""}


def _as_points(landmarks: LandmarkSet, measured: Arrays, fps: float) -> Points3D:
    return Points3D(
        landmarks=landmarks,
        points_world=measured["points_world"],
        covariance_world=measured["covariance_world"],
        residual_px=measured["residual_px"],
        inlier=measured["inlier"],
        fps=fps,
    )


def _select(
    cameras: CameraGroup, keypoints: Keypoints2D, options: TrackingOptions, fps: float
) -> tuple[Arrays, Mapping[str, Any]]:
    selection = select_person(cameras, keypoints, options, fps)
    others = [p.slots for p in selection.people[1:] if p.rank > 0]
    arrays = dict(_taken(keypoints, selection.slots))
    arrays["others"] = np.array(others, dtype=np.int64).reshape(-1, *selection.slots.shape)
    return arrays, {"reason": selection.reason}


def _sides(
    cameras: CameraGroup, keypoints: Keypoints2D, person: Arrays, options: FlipOptions
) -> tuple[Arrays, Mapping[str, Any]]:
    points_px, variance_px2, flipped = repair_flips(
        cameras, person["points_px"], person["variance_px2"], keypoints.landmarks, options
    )
    return {"points_px": points_px, "variance_px2": variance_px2, "flipped": flipped}, {}


def _points(
    cameras: CameraGroup, points_px: FloatArray, variance_px2: FloatArray, landmarks: LandmarkSet, fps: float,
    options: SolveOptions,
) -> tuple[Arrays, Mapping[str, Any]]:  # fmt: skip
    found = triangulate(cameras, points_px, variance_px2, options.triangulate)
    offsets = learn_view_bias(
        cameras, points_px, variance_px2, landmarks, fps, found, options.triangulate, options.view_bias
    )
    mended = points_px
    if offsets is not None:
        mended, found = without_view_bias(cameras, points_px, variance_px2, found, offsets, options.triangulate)
    found = with_pose_prior(
        cameras, mended, variance_px2, landmarks, fps, found, options.triangulate, options.pose_prior
    )
    wrong = stretched_limbs(found.points_world, landmarks)
    wrong |= uncertain_points(found.points_world, found.covariance_world, landmarks)
    # Reports are about what was seen, not about what was made of it.
    residual = np.linalg.norm(cameras.project(found.points_world) - points_px, axis=-1)
    arrays = {
        "points_world": found.points_world,
        "covariance_world": found.covariance_world,
        "residual_px": np.where(np.isfinite(variance_px2), residual, np.nan),
        "inlier": found.inlier,
    }
    facts = {"noise_px": found.noise_px, "view_bias_size_m": 0.0 if offsets is None else offsets.size_m}
    return _only(arrays, ~wrong), facts


def _only(measured: Arrays, there: BoolArray) -> dict[str, NDArray[Any]]:
    """The arrays of triangulated points, of those that are `there` (T, J)."""
    return {
        "points_world": np.where(there[..., None], measured["points_world"], np.nan),
        "covariance_world": np.where(there[..., None, None], measured["covariance_world"], np.nan),
        "residual_px": np.where(there, measured["residual_px"], np.nan),
        "inlier": measured["inlier"] & there,
    }


def _sure(score: FloatArray, flipped: BoolArray, landmarks: LandmarkSet, least: float) -> BoolArray:
    """(T, J) whether a camera is sure of a landmark, by scores (C, T, J) as they were before sides were put back."""
    own = np.where(flipped, score[..., list(landmarks.mirror)], score)
    return np.asarray(own.max(axis=0) >= least)


def _left_out(cameras: CameraGroup, sides: Arrays, options: TriangulateOptions) -> tuple[Arrays, Mapping[str, Any]]:
    error = leave_one_out_error(cameras, sides["points_px"], sides["variance_px2"], options)
    return {"leave_one_out_px": error}, {}


def _markers(
    cameras: CameraGroup, person: Arrays, landmarks: LandmarkSet, markers: Keypoints2D, options: SolveOptions
) -> tuple[Arrays, Mapping[str, Any]]:
    points_px, variance_px2, score = take_slots(markers, person["slots"])
    body = person["points_px"], person["variance_px2"], landmarks
    found = triangulate_markers(cameras, body, (points_px, variance_px2), options.flips, options.triangulate)
    sure = _sure(score, found["flipped"], markers.landmarks, options.confident_from)
    return _only(found, sure), {}


def _smooth(points: Points3D, options: SmoothOptions) -> tuple[Arrays, Mapping[str, Any]]:
    smoothed = smooth_points(points, options)
    arrays = {"points_world": smoothed.points_world, "covariance_world": smoothed.covariance_world}
    return arrays, {}


def _fit(points: Points3D, options: FitOptions) -> tuple[Arrays, Mapping[str, Any]]:
    fitted = fit_body(points, options)
    arrays, facts = _pack(fitted.motion)
    on_body = {
        "landmarks_world": landmarks_from_motion(fitted.motion, fitted.body, points.landmarks),
        # How far measured landmarks typically lie from the body's: what a filled one is known to.
        "landmark_sigma": np.array([np.median(r[np.isfinite(r)]) if np.isfinite(r).any() else np.nan
                                    for r in fitted.residual_m.T]),
    }  # fmt: skip
    return {**arrays, **on_body}, facts


def _filled(points: Points3D, measured: Points3D, sure: BoolArray, body: Arrays, share: float) -> Points3D:
    """`points` with what is missing taken from the fitted body, in frames where the body is well known: landmarks that
    are measured now and then, or sit on one bone with what is measured. Legs under a desk are not made up: what no
    camera is `sure` (T, J) of, most of the time, stays unknown."""
    there = np.asarray(np.isfinite(measured.points_world).all(-1))
    known = there.mean(1) >= share
    if not known.any():
        return points
    often = (there[known].mean(0) >= _NOW_AND_THEN) & (sure[known].mean(0) >= _MOSTLY_SURE)
    tied = there @ _on_one_bone(points.landmarks.names)
    gap = known[:, None] & np.isnan(points.points_world).any(-1) & np.isfinite(body["landmarks_world"]).all(-1)
    gap &= often | tied
    variance = np.broadcast_to(body["landmark_sigma"] ** 2, gap.shape)
    position, covariance = points.points_world.copy(), points.covariance_world.copy()
    position[gap] = body["landmarks_world"][gap]
    covariance[gap] = variance[gap][:, None, None] * np.eye(3)
    return replace(points, points_world=position, covariance_world=covariance)


def _on_one_bone(names: Sequence[str]) -> BoolArray:
    """(J, J) whether two landmarks keep their distance whatever the pose."""
    bones = []
    for name in names:
        side, part = name.split("_")[0], name.rsplit("_", 1)[-1]
        foot, face = part in ("ankle", "heel", "toe"), part in ("nose", "eye", "ear")
        bones.append(f"{side} foot" if foot else "face" if face else part if part in ("hip", "shoulder") else name)
    return np.array([[a == b for b in bones] for a in bones])


def _pack(motion: Motion) -> tuple[Arrays, Mapping[str, Any]]:
    """A motion as arrays and facts."""
    skeleton = motion.skeleton
    arrays = {
        "root_positions_world": motion.root_positions_world,
        "quat_wxyz": motion.quat_wxyz,
        "offsets": skeleton.offsets,
        "tips": skeleton.tips,
        "lower": skeleton.lower,
        "upper": skeleton.upper,
    }
    facts = {
        "fps": motion.fps,
        "names": skeleton.names,
        "parents": [int(p) for p in skeleton.parents],
        "twist_axis": [int(a) for a in skeleton.twist_axis],
    }
    return arrays, facts


def _unpack(stage: StageResult) -> Motion:
    arrays, facts = stage.arrays, stage.facts
    skeleton = Skeleton(
        names=tuple(facts["names"]),
        parents=tuple(facts["parents"]),
        offsets=arrays["offsets"],
        tips=arrays["tips"],
        twist_axis=tuple(facts["twist_axis"]),
        lower=arrays["lower"],
        upper=arrays["upper"],
    )
    return Motion(skeleton, facts["fps"], arrays["root_positions_world"], arrays["quat_wxyz"])
