"""The character of a run within its report: one more component of the page, which leaves the others alone."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from muybridge.infer.report.page import render_report
from muybridge.infer.viewer import Scene, read_scene
from tests.geometry.roles.bodies import human
from tests.infer.commands.test_retarget import body_file
from tests.infer.report.test_report import _CHROMIUM_FLAGS, _data


@pytest.fixture
def scene(tmp_path: Path) -> Scene:
    return read_scene(body_file(tmp_path / "hero.glb", human(np.random.default_rng(1)), 1))


def test_the_report_shows_the_character(scene: Scene) -> None:
    page, without = render_report(_data(character=scene, files=("hero.glb",))), render_report(_data())
    assert "The motion on hero.glb" in page and "The motion on" not in without
    assert page.count('class="viewer"') == 1 and 'class="viewer"' not in without and "class Viewer" not in without
    assert "</script>" not in re.search(r'data-part="data">(.*?)</script>', page, re.S)[1]  # type: ignore[index]
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))


@pytest.mark.slow
@pytest.mark.parametrize("size", [(1400, 1800), (390, 844)], ids=["desktop", "phone"])
def test_both_views_work_in_a_browser(tmp_path: Path, scene: Scene, size: tuple[int, int]) -> None:
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("chromium is absent")
    path = tmp_path / "report.html"
    probe = """<script>addEventListener("load", () => setTimeout(() => {
      const viewer = document.querySelector(".viewer"), at = viewer.viewer.seconds;
      viewer.viewer.step(3);
      const fits = document.documentElement.scrollWidth <= innerWidth;
      const out = [viewer.dataset.state, viewer.viewer.seconds !== at, fits];
      document.body.insertAdjacentHTML("beforeend", `<pre id="probe">${out}</pre>`);
    }, 1500));</script>"""
    page = render_report(_data(character=scene)).replace("</body>", probe + "</body>")
    # On top, since a headless browser draws what is in sight alone.
    page = page.replace('id="character"', 'id="character" style="position:fixed;inset:0"')
    path.write_text(page, encoding="utf-8")
    flags = [f for f in _CHROMIUM_FLAGS if f != "--disable-gpu"] + [
        "--use-angle=swiftshader",
        "--enable-unsafe-swiftshader",
    ]
    done = subprocess.run(
        [chromium, *flags, f"--user-data-dir={tmp_path / 'profile'}", f"--window-size={size[0]},{size[1]}",
         "--dump-dom", path.as_uri()], capture_output=True, text=True, timeout=120, check=True)  # fmt: skip
    found = re.findall(r'<pre id="probe">(.*?)</pre>', done.stdout)[-1]
    assert found == "ready,true,true", done.stderr[-2000:]
    assert "CONSOLE" not in done.stderr, done.stderr[-2000:]
