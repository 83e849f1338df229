"""The report's page in a browser, and its size for long takes."""

import html
import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.infer.report.data import PersonPage, ReportData
from muybridge.infer.report.page import render_report
from tests.infer.report.test_report import _CHROMIUM_FLAGS, _EXERCISE, FPS, J, _data, _rig, _scene, _walk


def _browser() -> str:
    for name in ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable"):
        found = shutil.which(name)
        if found:
            return found
    pytest.skip("no chromium to open the report in")


@pytest.mark.parametrize("size", [(1400, 1800), (390, 844)], ids=["desktop", "phone"])
def test_page_works_in_a_browser(tmp_path: Path, size: tuple[int, int]) -> None:
    browser = _browser()
    data = _data(warnings=("A camera was odd.",), timings_s={"triangulate": 1.5}, files=("points.trc",))
    world = data.points.points_world.copy()
    world[30:50, BODY23.index("left_wrist")] = np.nan
    data = replace(
        data,
        points=replace(data.points, points_world=world),
        joint_positions_world=_walk(120),
        joint_names=BODY23.names,
        joint_parents=(-1, *range(J - 1)),
    )
    page = render_report(data)
    path = tmp_path / "report.html"
    path.write_text(page.replace("<head>", "<head>" + _EXERCISE, 1), encoding="utf-8")
    done = subprocess.run(
        [
            browser, *_CHROMIUM_FLAGS, f"--user-data-dir={tmp_path / 'profile'}",
            f"--window-size={size[0]},{size[1]}", "--dump-dom", path.as_uri(),
        ],
        capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    probe = re.search(r'<pre id="probe">(.*?)</pre>', done.stdout, re.S)
    assert probe, done.stderr[-2000:]
    out = json.loads(html.unescape(probe.group(1)))
    assert out["said"] == [] and "CONSOLE" not in done.stderr, done.stderr[-2000:]
    assert out["requests"] == [] and out["ready"] == "yes"
    assert out["wide"] <= 0, "the page scrolls sideways"
    assert out["start"] == "frame 60 of 119", "it begins in the middle, where nothing is missing"
    assert out["scrubbed"] == "frame 17 of 119" and out["stepped"] == "frame 18 of 119"
    assert out["jumped"] == f"frame {out['wanted']} of 119" and 30 <= out["wanted"] < 50
    assert out["last"] == "frame 119 of 119"
    assert all(painted for _, painted in out["views"]) and out["timeline"]
    assert [name for name, _ in out["views"]][-4:] == ["cam01", "cam02", "cam03", "cam04"]
    # The page's own projection agrees with the camera's.
    camera = data.cameras["cam03"]
    expected = (camera.project(world[17]) + 0.5) / [camera.width, camera.height]
    np.testing.assert_allclose(out["projected"], expected, atol=5e-4)


def test_ten_minutes_stay_below_20_mb() -> None:
    frames = 10 * 60 * 60
    rig, world = _rig(), _walk(frames)
    residual = np.random.default_rng(0).rayleigh(1.0, (len(rig), frames, J))
    covariance = np.zeros((frames, J, 3, 3))
    points = Points3D(BODY23, world, covariance, residual, np.ones(residual.shape, bool), FPS)
    joints = points.points_world[:, :22]
    data = ReportData(
        title="long", cameras=rig, points=points, joint_positions_world=joints,
        joint_names=BODY23.names[:22], joint_parents=(-1, *range(21)),
    )  # fmt: skip
    page = render_report(data)
    assert len(page.encode()) < 20e6
    scene = _scene(page)
    assert scene["stride"] == 1 and len(scene["timeline"]["first"]) <= 1000


def test_people_are_numbered_and_linked() -> None:
    pages = (PersonPage("report.html", 1.0, 4.0), PersonPage("report_2.html", 0.75, 12.34))
    page = render_report(_data(number=2, others=(_walk(120) + 1.0,), pages=pages))
    assert _scene(page)["number"] == 2
    assert '<a href="report.html">Person 1</a> <span>100 % covered, 4.0 px left out</span>' in page
    assert 'aria-current="page">Person 2 <span>75 % covered, 12.3 px left out</span>' in page
    assert 'class="people"' not in render_report(_data())
