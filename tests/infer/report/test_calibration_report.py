"""The page of a calibration: the culprit by name, hopeless numbers behind low residuals, kept between runs."""

import re
from dataclasses import replace
from html.parser import HTMLParser
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from muybridge.geometry.calibration.bundle_adjustment.adjustment import AdjustProblem, FreeCamera, adjust
from muybridge.geometry.calibration.bundle_adjustment.result import solved
from muybridge.geometry.calibration.diagnosis.hypotheses import perturb_camera
from muybridge.geometry.calibration.diagnosis.quality import (
    CalibrationQuality,
    check_solved,
    check_take,
    plan_of,
    residual_picture,
)
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.infer.pipelines.calibration.check import format_summary
from muybridge.infer.reconstruction.judge import person_to_check
from muybridge.infer.reconstruction.judge_calibration import pack_quality, unpack_quality
from muybridge.infer.report.calibration_findings import calibration_findings
from muybridge.infer.report.calibration_page import CalibrationPage, render_calibration
from tests.rigs import ring_of_cameras


def _rig(count: int = 4) -> CameraGroup:
    names = [f"cam<{k + 1}>" for k in range(count)]
    return ring_of_cameras(names, target=(0, 0, 0.9), size=(1280, 960), focal=1200)


@pytest.fixture(scope="module")
def turned(staged_people: ModuleType) -> CalibrationQuality:
    """A take in which the second camera was turned by a degree after its calibration."""
    rig = _rig()
    rng = np.random.default_rng(2)
    px = rig.project(staged_people.person(60)) + rng.normal(0, 1.5, (4, 60, 23, 2)) + rng.normal(0, 1.5, (4, 1, 23, 2))
    wrong = perturb_camera(rig[1], np.array([0.0, np.radians(1.0), 0, 0, 0, 0, 0]))
    cameras = CameraGroup(tuple(wrong if k == 1 else c for k, c in enumerate(rig)))
    return check_take(cameras, px, np.full(px.shape[:-1], 4.0), source="a staged person")


def test_the_page_names_the_faulty_camera_first(turned: CalibrationQuality) -> None:
    page = render_calibration(CalibrationPage("two <degrees>", turned, ("a note & more",)))
    assert "Look at cam&lt;2&gt;" in page and re.search("cam&lt;2&gt; was turned by 1.0 ± 0.[1-9] degrees", page)
    assert "two &lt;degrees&gt;" in page and "a note &amp; more" in page and "<degrees>" not in page
    rows = re.findall(r'<th scope="row">([^<]*)</th>', page)
    assert rows[0] == "cam&lt;2&gt;" and len(rows) == 8  # figures and evidence, the culprit first in both
    assert page.count('<figure class="residuals">') == 4 and page.count('<g class="camera fault">') == 1
    assert "://" not in page and "nan" not in page.lower()

    class Tags(HTMLParser):
        stack: list[str] = []

        def handle_starttag(self, tag: str, attributes: Any) -> None:
            if tag not in ("meta", "link", "br", "img"):
                self.stack.append(tag)

        def handle_startendtag(self, tag: str, attributes: Any) -> None:
            pass

        def handle_endtag(self, tag: str) -> None:
            assert self.stack.pop() == tag

    parser = Tags()
    parser.feed(page)
    assert parser.stack == []
    lines = format_summary(turned)
    assert "cam<2>" in lines[0] and lines[1].strip().startswith("cam<2>") and lines[1].endswith("turned")


def test_of_two_cameras_none_can_be_left_out(staged_people: ModuleType) -> None:
    rig = CameraGroup(_rig().cameras[:2])
    px = rig.project(staged_people.person(40)) + np.random.default_rng(3).normal(0, 1.5, (2, 40, 23, 2))
    quality = check_take(rig, px, np.full(px.shape[:-1], 4.0), source="a staged person")
    lines = format_summary(quality)
    assert len(lines) == 3 and all("reprojection" in line for line in lines[1:])
    assert "nan" not in "".join(lines) + render_calibration(CalibrationPage("two", quality)).lower()


def test_calibration_quality_survives_packing(turned: CalibrationQuality) -> None:
    arrays, facts = pack_quality(turned)
    back = unpack_quality(turned.cameras, arrays, facts)
    page = CalibrationPage("same", turned)
    assert render_calibration(page) == render_calibration(CalibrationPage("same", back))
    assert back.diagnosis is not None and turned.diagnosis is not None
    assert back.diagnosis.faults == turned.diagnosis.faults
    assert back.diagnosis.cameras.cameras == turned.diagnosis.cameras.cameras


def test_a_low_residual_with_an_uncertain_focal_length_is_reported() -> None:
    """A small plane seen straight on by one camera: any focal length fits, with the distance to match."""
    rng = np.random.default_rng(4)
    camera = _rig()[0]
    across = np.stack(np.meshgrid(np.linspace(-0.2, 0.2, 6), np.linspace(-0.2, 0.2, 6)), axis=-1).reshape(-1, 2)
    points = camera.center_world + across @ camera.rotation[:2] + 4.0 * camera.rotation[2]
    points += rng.normal(0, 0.004, (36, 1)) * camera.rotation[2]
    pixels = camera.project(points) + rng.normal(0, 0.2, (36, 2))
    problem = AdjustProblem(
        CameraGroup((camera,)), np.zeros(36, int), np.arange(36), pixels, np.full(36, 0.2), points,
        np.zeros(36, bool), (FreeCamera(focal=True),),
    )  # fmt: skip
    quality = check_solved(solved(problem, adjust(problem), np.zeros(36, int), points), "a plate")
    assert quality.residual_px[0] < 0.5 and quality.focal_sd[0] > 0.03
    grave = [f.text for f in calibration_findings(quality) if f.severity == "bad"]
    assert len(grave) == 1 and "focal length of cam<1>" in grave[0] and "no proof" in grave[0]
    high = replace(quality, residual_px=np.array([90.0]))
    (said,) = (f.text for f in calibration_findings(high) if f.severity == "bad")
    assert "no proof" not in said and "its residual is 90.00 px" in said
    page = render_calibration(CalibrationPage("plate", quality))
    assert "Not to be trusted" in page and f"±{100 * quality.focal_sd[0]:.1f} %" in page


def test_residuals_over_an_image_are_counted() -> None:
    camera = _rig()[0]
    px = np.array([[10.0, 10.0], [20.0, 30.0], [1270.0, 950.0], [np.nan, 5.0], [5000.0, 5.0]])
    picture = residual_picture(camera, px, np.tile([3.0, -4.0], (5, 1)))
    assert picture.count.shape == (9, 12) and picture.count[0, 0] == 2 and picture.count[-1, -1] == 1
    assert picture.count.sum() == 3 and picture.covered == pytest.approx(2 / 108)
    assert picture.median_px[0, 0] == 5.0 and picture.mean_px[0, 0].tolist() == [3.0, -4.0]


def test_the_plan_counts_images() -> None:
    rig = _rig()
    points = np.array([[0.0, 0, 0.9], [0.1, 0, 0.9], [np.nan, 0, 0]])
    plan = plan_of(rig, points, np.array([4, 2, 0]))
    row, column = np.floor((np.zeros(2) - plan.low)[::-1] / plan.cell).astype(int)
    assert plan.cameras[row, column] == 4
    corner = [*(plan.low + plan.cell / 2), plan.height]
    seen = [((px > -0.5) & (px < [1279.5, 959.5])).all() for px in rig.project(np.array(corner))]
    assert plan.cameras[0, 0] == sum(seen) < 4
    assert plan.seen_by_three == 0.5 and plan.height == pytest.approx(0.9) and len(plan.points) == 2


def test_a_camera_that_contradicts_the_calibration_keeps_its_person(staged_people: ModuleType) -> None:
    from muybridge.geometry.landmarks.arrays import Keypoints2D
    from muybridge.geometry.landmarks.sets import BODY23

    rig = _rig()
    px = rig.project(staged_people.person(30))
    px[[0, 2]] = px[[2, 0]]  # two files exchanged
    keypoints = Keypoints2D(BODY23, px[:, :, None], np.full((4, 30, 1, 23), 4.0), np.ones((4, 30, 1, 23)))
    points_px, variance = person_to_check(rig, keypoints, 30.0)
    assert np.isfinite(points_px).all() and np.isfinite(variance).all()
