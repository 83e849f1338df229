"""From the cameras' 2D landmarks to the motion of one person or of everyone: the stages that need no video."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from muybridge.arrays import BoolArray, FloatArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.association.options import TrackingOptions
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.fitting.body_fit import FitOptions
from muybridge.geometry.landmarks.arrays import Keypoints2D, Points3D
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.smoothing.kalman import SmoothOptions, smooth_points
from muybridge.geometry.triangulation.left_right import FlipOptions
from muybridge.geometry.triangulation.multiview import TriangulateOptions
from muybridge.geometry.triangulation.shape_prior import PosePriorOptions
from muybridge.geometry.triangulation.view_bias import ViewBiasOptions
from muybridge.infer.detection.refine import RefinedTake, TopDownRefinement
from muybridge.infer.reconstruction import person_stages as compute
from muybridge.infer.reconstruction.body_motion import fill_from_body, fitted_motion
from muybridge.infer.reconstruction.motion_arrays import unpack_motion
from muybridge.infer.runtime.digests import code_digest
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import Arrays, StageResult, Stages, StageStore

_log = logging.getLogger(__name__)

# Appended to the names of stages that follow the refinement.
_REFINED = ", refined"
# For people seen whole, the most confident camera is nearly always over 0.8; for landmarks that no image shows, the
# confidence is 0.1 to 0.5.
MIN_CONFIDENCE = 0.5


@dataclass(frozen=True)
class SolveOptions:
    """How 2D landmarks become motion.

    Attributes:
        tracking: which person is tracked.
        flips: repair of left-right flips in single cameras.
        triangulate: 3D points.
        view_bias: view-dependent bias of 2D landmarks, learned from the take.
        pose_prior: constraints on a point from the rest of the body and of the take.
        smooth: points over time.
        fit: the skeleton and its joint angles.
        min_confidence: minimum confidence, in 0..1; landmarks below it in every camera are treated as missing, so that
            people of whom the cameras see only a part are not made whole. 0 keeps every guess; None for the value on
            the network's card, which is 0.5 for muybridge's own networks.
        fill_share: a missing landmark is taken from the fitted body in frames where at least this share of the
            landmarks was measured; above 1, never.
        everyone: track and write the other people too: `points_2.trc`, `motion_2.bvh` and so on.
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
        """The same, with the minimum confidence on the network's card unless another one was asked for."""
        return self if self.min_confidence is not None else replace(self, min_confidence=min_confidence)


@dataclass(frozen=True)
class Solution:
    """One person's take in 3D.

    Attributes:
        person: one sentence: who was tracked, and why.
        points_px: (C, T, J, 2) the person's 2D landmarks, left-right flips repaired; NaN where missing.
        variance_px2: (C, T, J).
        measured: the triangulated points.
        unsure: (T, J) where cameras have a landmark and none is confident of it; it is not measured there.
        points: the same, smoothed, with gaps filled.
        flipped: (C, T, J) where a left-right flip was repaired.
        leave_one_out_px: (C, T, J) see `geometry.triangulation.validation.leave_one_out_error`.
        noise_px: noise of the take beyond the network's own variance.
        motion: the fitted skeleton; None where the points did not suffice for one.
        no_motion: why there is none.
        markers: virtual markers on the skin, smoothed; None where they were not asked for.
        stages: the stages by name, in order, for their timings.
        others: the other people seen by two cameras, where everyone was asked for; they have no others.
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
    cameras: CameraGroup, keypoints: Mapping[str, Keypoints2D], fps: float, inputs: str, store: StageStore,
    options: SolveOptions, progress: Progress, refinement: TopDownRefinement | None = None,
) -> Solution:  # fmt: skip
    """Track the person of interest through the take, or everyone.

    Args:
        cameras: C cameras, at the size of the videos.
        keypoints: everyone who was found, by landmark set; the body's set comes first, and the virtual markers are
            `surface`.
        fps: frames per second.
        inputs: digest of what the keypoints were made from.
        store: where finished stages are.
        options: of the stages.
        progress: receives progress messages.
        refinement: reads a person's views again once the person is known in 3D.
    """
    code = code_digest("muybridge.geometry", "muybridge.infer.reconstruction")
    stage = Stages(store, progress, [inputs, code, fps])
    take = _Take(stage, cameras, keypoints, fps, options)
    person = stage(
        "person", options.tracking, lambda: compute.person_of_interest(cameras, take.body, options.tracking, fps)
    )
    main = _solve_person(take, "", person, refinement)
    if not options.everyone:
        several = len(person.arrays["others"]) > 0
        return replace(main, person=f"{main.person}; --everyone writes them too") if several else main
    others = []
    for n, slots in enumerate(person.arrays["others"], start=2):
        one = stage(f"person {n}", person.key, partial(compute.further_person, take.body, slots))
        others.append(_solve_person(take, f" {n}", one, refinement))
    files = "; each further person seen by two cameras has their own files" if others else ""
    return replace(main, person=main.person + files, others=tuple(others))


@dataclass(frozen=True)
class _Take:
    """What is the same for everyone in a take."""

    stage: Stages
    cameras: CameraGroup
    keypoints: Mapping[str, Keypoints2D]
    fps: float
    options: SolveOptions

    @property
    def body(self) -> Keypoints2D:
        """The body's landmarks."""
        return next(iter(self.keypoints.values()))


class _Person(NamedTuple):
    """One person's 2D landmarks and 3D points.

    Attributes:
        take: with the refined landmarks, where there was a refinement.
        landmarks: stage of the person's 2D landmarks.
        flips: stage of the same with left-right flips repaired.
        cloud: stage of the triangulated points.
        refined: result of the refinement; None without one.
    """

    take: _Take
    landmarks: StageResult
    flips: StageResult
    cloud: StageResult
    refined: RefinedTake | None = None


def _read_person(take: _Take, number: str, person: StageResult, refinement: TopDownRefinement | None) -> _Person:
    """One person's 2D landmarks, refined where the first 3D points predict them, and triangulated."""
    flips, cloud = _triangulate(take, number, person)
    if refinement is None:
        return _Person(take, person, flips, cloud)
    measured = compute.as_points(take.body.landmarks, cloud.arrays, take.fps)
    # With default options: another cut-off frequency of the result needs no other refinement.
    expected = smooth_points(measured, SmoothOptions())
    refined = refinement(person.arrays["slots"], measured, expected, number.replace(" ", "-"))
    if refined is None:
        _log.info("person%s: the refinement found nothing new", number or " 1")
        return _Person(take, person, flips, cloud)
    take.stage.done |= refined.stages
    take, reason = replace(take, keypoints=refined.keypoints), str(person.facts["reason"])
    person = take.stage(
        f"person{number}{_REFINED}", [person.key, [s.key for s in refined.stages.values()]],
        lambda: (compute.landmarks_in_slots(take.body, refined.slots), {"reason": reason}),
    )  # fmt: skip
    return _Person(take, person, *_triangulate(take, number + _REFINED, person), refined)


def _triangulate(take: _Take, suffix: str, person: StageResult) -> tuple[StageResult, StageResult]:
    """The stages of the person's landmarks without left-right flips, and of the triangulated points."""
    stage, cameras, options = take.stage, take.cameras, take.options
    flips = stage(
        f"flips{suffix}", [person.key, options.flips],
        lambda: compute.without_flips(cameras, take.body, person.arrays, options.flips),
    )  # fmt: skip
    cloud = stage(
        f"points{suffix}", [flips.key, options.triangulate, options.view_bias, options.pose_prior],
        lambda: compute.triangulated(cameras, flips.arrays, take.body.landmarks, take.fps, options.triangulate,
                                     options.view_bias, options.pose_prior),
    )  # fmt: skip
    return flips, cloud


def _solve_person(take: _Take, number: str, person: StageResult, refinement: TopDownRefinement | None) -> Solution:
    """One person from 2D landmarks to motion; `number` is appended to the names of the stages."""
    read = _read_person(take, number, person, refinement)
    take, flips, cloud = read.take, read.flips, read.cloud
    stage, fps, options, landmarks = take.stage, take.fps, take.options, take.body.landmarks
    score = read.landmarks.arrays["score"]
    confident = compute.confident(score, flips.arrays["flipped"], landmarks, options.confident_from)
    unsure = ~confident & np.isfinite(cloud.arrays["points_world"]).all(-1)
    measured = compute.as_points(landmarks, compute.only(cloud.arrays, confident), fps)
    left_out = _leave_one_out(read, number)
    given = [cloud.key, options.confident_from]
    smooth = stage(f"smooth{number}", [*given, options.smooth], lambda: compute.smoothed(measured, options.smooth))
    points = replace(
        measured, points_world=smooth.arrays["points_world"], covariance_world=smooth.arrays["covariance_world"]
    )
    motion, no_motion = None, ""
    try:
        fitted = stage(f"motion{number}", [*given, options.fit], lambda: fitted_motion(measured, options.fit))
        motion = unpack_motion(fitted.arrays, fitted.facts)
        points = fill_from_body(points, measured, confident, fitted.arrays, options.fill_share)
    except MuybridgeError as error:
        # The points and the overlays show the cause: they are worth writing without a motion.
        no_motion = str(error)
        _log.info("person%s: no motion: %s", number or " 1", no_motion)
    return Solution(
        person=str(read.landmarks.facts["reason"]),
        points_px=flips.arrays["points_px"],
        variance_px2=flips.arrays["variance_px2"],
        measured=measured,
        unsure=unsure,
        points=points,
        flipped=flips.arrays["flipped"],
        leave_one_out_px=left_out.arrays["leave_one_out_px"],
        noise_px=float(cloud.facts["noise_px"]),
        motion=motion,
        no_motion=no_motion,
        markers=_virtual_markers(read, number),
        stages=stage.done,
    )


def _leave_one_out(read: _Person, number: str) -> StageResult:
    """The stage of the leave-one-camera-out error."""
    cameras, options = read.take.cameras, read.take.options

    def flips_of_views_alone() -> Arrays:
        # Refined views agree with the others because they were predicted from them: use what each view reads alone.
        if read.refined is None:
            return read.flips.arrays
        alone, slots = read.refined.alone, read.refined.slots
        return compute.without_flips(cameras, alone, compute.landmarks_in_slots(alone, slots), options.flips)[0]

    return read.take.stage(
        f"left out{number}", [read.landmarks.key, options.flips, options.triangulate],
        lambda: compute.leave_one_out(cameras, flips_of_views_alone(), options.triangulate),
    )  # fmt: skip


def _virtual_markers(read: _Person, number: str) -> Points3D | None:
    """The person's virtual markers, smoothed; None where they were not asked for."""
    take, options = read.take, read.take.options
    markers = take.keypoints.get(SURFACE.name)
    if markers is None:
        return None
    skin = take.stage(
        f"markers{number}", [read.landmarks.key, options.flips, options.triangulate, options.confident_from],
        lambda: compute.virtual_markers(
            take.cameras, read.landmarks.arrays, take.body.landmarks, markers, options.flips, options.triangulate,
            options.confident_from),
    )  # fmt: skip
    return smooth_points(compute.as_points(markers.landmarks, skin.arrays, take.fps), options.smooth)
