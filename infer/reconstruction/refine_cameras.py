"""Refinement of the cameras' poses from the person, before anything is triangulated."""

import time
from dataclasses import replace

import numpy as np

from muybridge.errors import MuybridgeError
from muybridge.geometry.association.options import TrackingOptions
from muybridge.geometry.association.select import PersonSelection, select_person, take_person
from muybridge.geometry.calibration.people.calibrate import PeopleCalibrationOptions, refine_people
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.triangulation.left_right import repair_flips
from muybridge.geometry.triangulation.validation import leave_one_out_error
from muybridge.infer.runtime.digests import code_digest, digest
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import StageResult, StageStore
from muybridge.infer.session.session import Session, with_notice

STAGE = "refine"
# 2D landmarks have the same view-dependent bias in both halves of a take. Poses that compensate for it seem better by a
# few per cent in the second half too, even for correct cameras, and make the points worse.
_LEAST_GAIN = 0.1
# A camera that was turned by two degrees sees everybody elsewhere: if it has the person in less than this share of the
# frames of another camera, the association accepts views that are farther off.
_HARDLY_SEEN = 0.5
_FARTHER_OFF = TrackingOptions(gate=0.3, start=0.15, odd_view=0.3)


def refine(
    session: Session, keypoints: Keypoints2D, inputs: str, store: StageStore, progress: Progress
) -> tuple[Session, StageResult | None]:
    """A session with cameras refined from its person, and a notice about the improvement.

    Poses from the take's first half are evaluated on its second half only: the figures before and after are from frames
    that were not used. Where they do not improve clearly, the cameras stay as they are.

    Args:
        session: C cameras as calibrated.
        keypoints: everyone who was found.
        inputs: digest of what the keypoints were made from.
        store: where finished stages are.
        progress: receives progress messages.
    """
    key = digest(STAGE, inputs, code_digest("muybridge.geometry", "muybridge.infer.reconstruction"))
    stage = store.load(STAGE, key)
    if stage is None:
        start = time.perf_counter()
        try:
            poses, before, after = _poses(session.cameras, keypoints, session.fps)
        except MuybridgeError as error:
            return with_notice(session, f"the cameras were not refined: {error}", progress), None
        facts = {"before_px": before, "after_px": after}
        stage = store.save(STAGE, key, {"cam_from_world": poses}, facts, time.perf_counter() - start)
        progress.say(f"{STAGE}: {stage.seconds:.1f} s")
    before, after = float(stage.facts["before_px"]), float(stage.facts["after_px"])
    found = CameraGroup(tuple(c.posed(p) for c, p in zip(session.cameras, stage.arrays["cam_from_world"], strict=True)))
    session = with_notice(session, _notice(session.cameras, found, before, after), progress)
    return replace(session, cameras=found if _better(before, after) else session.cameras), stage


def person_of(cameras: CameraGroup, keypoints: Keypoints2D, fps: float) -> PersonSelection:
    """The take's person, as `select_person`, in cameras of which some may be turned by a few degrees."""
    selection = select_person(cameras, keypoints, fps=fps)
    seen = (selection.slots >= 0).mean(1)
    if seen.min() >= _HARDLY_SEEN * seen.max():
        return selection
    farther = select_person(cameras, keypoints, _FARTHER_OFF, fps)
    return farther if (farther.slots >= 0).mean(1).min() > seen.min() else selection


def _poses(cameras: CameraGroup, keypoints: Keypoints2D, fps: float) -> tuple[np.ndarray, float, float]:
    """(C, 3, 4) refined poses, and the median leave-one-out error in held-out frames before and after, px."""
    px, variance, _ = take_person(keypoints, person_of(cameras, keypoints, fps))
    px, variance, _ = repair_flips(cameras, px, variance, keypoints.landmarks)
    names, options = keypoints.landmarks.names, PeopleCalibrationOptions()
    result = refine_people(cameras, px, variance, names, options).cameras
    middle = px.shape[1] // 2
    half = refine_people(cameras, px[:, :middle], variance[:, :middle], names, options).cameras
    errors = [leave_one_out_error(rig, px[:, middle:], variance[:, middle:]) for rig in (cameras, half)]
    both = np.isfinite(errors[0]) & np.isfinite(errors[1])
    if not both.any():
        raise MuybridgeError("no landmark of the take's second half is seen by three cameras")
    before, after = (float(np.median(e[both])) for e in errors)
    return result.cam_from_world, before, after


def _better(before_px: float, after_px: float) -> bool:
    """Whether the left-out error fell by more than compensated bias explains."""
    return after_px < (1 - _LEAST_GAIN) * before_px


def _notice(before: CameraGroup, after: CameraGroup, before_px: float, after_px: float) -> str:
    improvement = (
        f"median leave-one-camera-out error {before_px:.1f} px before, {after_px:.1f} px after, in frames that "
        "were not used"
    )
    if not _better(before_px, after_px):
        return f"the cameras were not refined from the person, because that would hardly improve them: {improvement}"
    changes = []
    for a, b in zip(before, after, strict=True):
        cosine = (np.trace(a.rotation @ b.rotation.T) - 1) / 2
        turned = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        moved = 1000 * np.linalg.norm(a.center_world - b.center_world)
        changes.append(f"{a.name} by {turned:.1f} degrees and {moved:.0f} mm")
    return f"the cameras' poses were refined from the person ({', '.join(changes)}): {improvement}"
