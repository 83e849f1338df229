"""Short takes: nobody is accused where the calibration is good, and the right camera where it is not."""

import pickle
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from muybridge.geometry.association.select import select_person, take_person
from muybridge.geometry.calibration.diagnosis.faults import diagnose
from muybridge.geometry.calibration.diagnosis.findings import Fault
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.infer.reconstruction.judge import person_to_check
from scripts.benchmarks.geometry.short_take_simulator import simulate
from scripts.benchmarks.geometry.short_takes import faulty_take, judged, outcome

_FIRST = 5000


def _accused(seeds: range, frames: int | None = None) -> list[str]:
    """Sentences of the faults in takes of good calibrations."""
    found = []
    for seed in seeds:
        take = simulate(seed, None if frames is None else 10 + (7 * seed) % frames)
        report = judged(take)
        found += [f"seed {seed}, {take.description}: {f.sentence}" for f in (report.faults if report else ())]
    return found


def test_no_camera_is_accused_in_short_takes_of_good_calibrations() -> None:
    assert not _accused(range(_FIRST, _FIRST + 20), 25)
