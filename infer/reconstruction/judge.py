"""The quality of a calibration by the 2D landmarks of a session's person."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.association.options import TrackingOptions
from muybridge.geometry.association.select import take_person
from muybridge.geometry.calibration.diagnosis.findings import DiagnosisOptions
from muybridge.geometry.calibration.diagnosis.quality import CalibrationQuality, check_take
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.infer.reconstruction.person_stages import select_once

_HARDLY = 0.2  # share of frames below which the association has failed for a camera
_RARELY = 0.05  # share of frames in which a camera may see two people where the take is of one person


def check_keypoints(
    cameras: CameraGroup, keypoints: Keypoints2D, options: DiagnosisOptions | None, fps: float
) -> CalibrationQuality:
    """The quality of a calibration by the landmarks of one tracked person, diagnosed with the options, if any.

    Raises:
        SessionError: nobody was found.
    """
    points_px, variance_px2 = person_to_check(cameras, keypoints, fps)
    source = f"one person's landmarks in {points_px.shape[1]} frames"
    return check_take(cameras, points_px, variance_px2, options, source)


def person_to_check(cameras: CameraGroup, keypoints: Keypoints2D, fps: float) -> tuple[FloatArray, FloatArray]:
    """One person's landmarks, including those of cameras that do not fit the calibration.

    The association between cameras depends on the calibration in question. So in a take of one person, a camera that
    is hardly associated with that person, but sees somebody for most of the take, is assumed to see the same person.
    Where several people are in the room it may well be another one.

    Returns:
        (C, T, J, 2) px and (C, T, J) variances.
    """
    selection = select_once(cameras, keypoints, TrackingOptions(), fps)
    points_px, variance_px2, _ = take_person(keypoints, selection)
    points_px, variance_px2 = points_px.copy(), variance_px2.copy()
    found = np.asarray(np.isfinite(keypoints.variance_px2).any(axis=-1))
    several = (found.sum(axis=-1) > 1).mean(axis=1).max() > _RARELY
    tracked = sum(len(person.cameras) > 1 for person in selection.people)
    for c in range(0 if several or tracked > 1 else len(cameras)):
        alone = found[c].sum(axis=1) == 1
        if (selection.slots[c] >= 0).mean() < _HARDLY and alone.mean() > 0.5:
            frames = np.flatnonzero(alone)
            slots = found[c, frames].argmax(axis=1)
            points_px[c, frames] = keypoints.points_px[c, frames, slots]
            variance_px2[c, frames] = keypoints.variance_px2[c, frames, slots]
    return points_px, variance_px2
