"""Short takes: nobody is accused where the calibration is good, and the right camera where it is not."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from muybridge.geometry.association.select import select_person
from muybridge.geometry.calibration.diagnosis.faults import diagnose
from muybridge.geometry.calibration.people.calibrate import refine_people
from muybridge.infer.reconstruction.judge import person_to_check
from scripts.benchmarks.geometry.diagnosis import balancing
from scripts.benchmarks.geometry.short_take_simulator import ShortTake, simulate
from scripts.benchmarks.geometry.short_takes import faulty_take, judged, outcome

_FIRST = 5000


def _accused(takes: list[ShortTake]) -> list[str]:
    """Sentences of the faults found in takes of good calibrations."""
    reports = [(take, judged(take)) for take in takes]
    return [f"{t.description}: {f.sentence}" for t, report in reports for f in (report.faults if report else ())]


def test_no_camera_is_accused_in_short_takes_of_good_calibrations() -> None:
    seeds = range(_FIRST, _FIRST + 20)
    assert not _accused([simulate(s, 10 + 7 * s % 15, 3) for s in seeds])


@pytest.mark.slow
def test_no_camera_is_accused_in_two_hundred_takes_of_good_calibrations() -> None:
    accused = _accused([simulate(s) for s in range(_FIRST, _FIRST + 200)])
    assert not accused, accused


@pytest.mark.parametrize(("kind", "size"), [("turned", 2.0), ("swapped", 0), ("shifted", 8)])
def test_large_faults_are_found_in_short_takes(kind: str, size: float) -> None:
    take, guilty = faulty_take(kind, size, 50, _FIRST)
    report = judged(take)
    _, named, _ = outcome(report, guilty)
    assert report is not None and named, report
    if kind != "swapped":
        fault = report.faults[0]
        assert 0 < fault.sd < abs(fault.amount) / 4
        unit = "degrees" if kind == "turned" else "frames"
        assert re.search(rf"\d\.\d ± \d\.\d {unit}", fault.sentence), fault.sentence


@pytest.mark.parametrize("seed", [_FIRST, _FIRST + 1])
def test_a_video_three_frames_late_is_found_in_a_hundred_frames(seed: int) -> None:
    take, guilty = faulty_take("shifted", 3, 100, seed)
    report = judged(take)
    assert report is not None and outcome(report, guilty)[0], report


def test_a_late_video_of_somebody_who_stands_still_is_not_accused() -> None:
    for seed in range(_FIRST, _FIRST + 2):
        report = judged(simulate(seed, 40, 4, 1, "still", late=(1, 6)))
        assert report is not None and not report.faults, report.sentence


def test_another_person_alone_in_a_view_is_not_taken_for_the_same() -> None:
    take = simulate(_FIRST, 40, 4, 2, "walking")
    keypoints = take.keypoints
    slots = select_person(take.cameras, keypoints, fps=take.fps).slots
    px, variance, score = (a.copy() for a in (keypoints.points_px, keypoints.variance_px2, keypoints.score))
    chosen = slots[..., None] == np.arange(2)
    # The chosen person is hidden from the fourth camera; the first two see nobody else.
    hidden = np.concatenate([~chosen[:2], 0 * chosen[2:3] > 0, chosen[3:]])
    px[hidden], variance[hidden], score[hidden] = np.nan, np.nan, 0.0
    alone = replace(keypoints, points_px=px, variance_px2=variance, score=score)
    checked, _ = person_to_check(take.cameras, alone, take.fps)
    assert chosen[3].any(axis=1).mean() > 0.8 and np.isfinite(checked[3, ..., 0]).any(axis=1).mean() < 0.2
    report = diagnose(take.cameras, *person_to_check(take.cameras, alone, take.fps))
    assert not report.faults, report.sentence


@pytest.mark.parametrize("length", [30, *(pytest.param(n, marks=pytest.mark.slow) for n in (10, 15, 20, 45, 70, 100))])
def test_pieces_of_a_real_take_are_silent(real_data: Path, length: int) -> None:
    """With the cameras refined from the whole take, which has no faults then."""
    (cameras, px, variance), names = balancing(real_data)
    refined = refine_people(cameras, px, variance, names).cameras
    step = 70 if length == 30 else max(length // 2, 10)
    for first in range(0, px.shape[1] - length + 1, step):
        piece = slice(first, first + length)
        report = diagnose(refined, px[:, piece], variance[:, piece])
        assert not report.faults, (first, report.sentence)
