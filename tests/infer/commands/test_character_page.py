"""The page of `muybridge character --page`: the result is seen moving, whatever the format that it is written in."""

import base64
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from muybridge.infer.commands.motion.character import character
from muybridge.motion.character import read_character
from tests.geometry.roles.bodies import human
from tests.infer.commands.test_character import obj, refused
from tests.infer.commands.test_retarget import body_file
from tests.motion.character.rigging.figures import person


@pytest.fixture(scope="module")
def hero(tmp_path_factory):
    return obj(tmp_path_factory.mktemp("mesh") / "hero.obj", *person(40.0)[:2])


@pytest.fixture(scope="module")
def takes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("takes")
    return tuple(body_file(folder / f"{name}.bvh", human(np.random.default_rng(k))) for k, name in enumerate("ab"))


def shown(page: Path) -> dict:
    found = re.search(r'<script type="application/json" data-part="data">(.*?)</script>', page.read_text(), re.S)
    assert found is not None
    return json.loads(found[1])


def test_all_takes_are_seen_beside_each_other(tmp_path, hero, takes, capsys):
    out, page = tmp_path / "a.fbx", tmp_path / "a.html"
    assert character(hero, motion=takes, out=out, page=page) == 0
    assert capsys.readouterr().out.splitlines()[-2:] == [str(out), str(page)]
    data = shown(page)
    assert [take["name"] for take in data["takes"]] == ["a", "b"] and data["apart"]
    assert [take["frames"] for take in data["takes"]] == [20, 20]
    assert data["takes"][0]["meshes"] and data["takes"][0]["contacts"]
    assert character(hero, motion=takes[:1], out=tmp_path / "a.glb", page=page) == 0  # its own page is replaced
    places = shown(page)["takes"][0]["places"]
    codes = np.frombuffer(base64.b64decode(places["data"]), "<i2").reshape(20, -1, 3)
    motion = read_character(tmp_path / "a.glb").motion
    seen = np.array(places["offset"]) + places["step"] * codes
    assert np.abs(seen - motion.joint_positions_world()).max() < 1e-3


def test_takes_beyond_the_size_of_a_page_are_named(tmp_path, hero, takes, capsys, monkeypatch):
    monkeypatch.setattr("muybridge.infer.pipelines.characters.pages.MOST_BYTES", 10)
    page = tmp_path / "a.html"
    assert character(hero, motion=takes, out=tmp_path / "a.glb", page=page) == 0
    assert "1 of 2 takes" in " ".join(capsys.readouterr().err.split())
    assert [take["name"] for take in shown(page)["takes"]] == ["a"]


def test_a_page_in_a_bad_place_is_refused_before_any_work(tmp_path, hero, takes, capsys, monkeypatch):
    def late(*_, **__):
        raise AssertionError("the joints were looked for before the page was refused")

    monkeypatch.setattr("muybridge.infer.commands.motion.character.rig_static", late)
    out, other = tmp_path / "a.glb", tmp_path / "other.html"
    other.write_text("of another program")
    (tmp_path / "folder.html").mkdir()
    for page, said in ((tmp_path / "a.txt", "ends in .html"), (other, "give --overwrite"),
                       (tmp_path / "folder.html", "is a folder"), (out, "ends in .html")):  # fmt: skip
        line = refused(capsys, hero, motion=takes, out=out, page=page)
        assert line.startswith(str(page)) and said in line
    assert "only with motion" in refused(capsys, hero, write_joints=tmp_path / "j.toml", page=tmp_path / "b.html")
    line = refused(capsys, hero, rig_only=True, out=out, page=tmp_path / "b.html", write_joints=tmp_path / "b.html")
    assert "named for two results" in line
    assert other.read_text() == "of another program" and not out.exists()


@pytest.mark.slow
@pytest.mark.parametrize("size", ["1400,900", "390,844"], ids=["desktop", "phone"])
def test_a_browser_shows_it_moving_without_an_error(tmp_path, hero, takes, size):
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("chromium is absent")
    page = tmp_path / "a.html"
    assert character(hero, motion=takes, out=tmp_path / "a.glb", page=page) == 0
    probe = """<script>addEventListener("load", () => setTimeout(() => {
      const viewer = document.querySelector(".viewer"), at = viewer.viewer.seconds;
      viewer.viewer.step(3);
      const out = [viewer.dataset.state, viewer.viewer.seconds !== at,
        document.documentElement.scrollWidth <= innerWidth];
      document.body.insertAdjacentHTML("beforeend", `<pre id="probe">${out}</pre>`);
    }, 1500));</script>"""
    page.write_text(page.read_text().replace("</body>", probe + "</body>"))
    done = subprocess.run(
        [chromium, "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
         "--enable-logging=stderr", f"--user-data-dir={tmp_path / 'profile'}", f"--window-size={size}",
         "--virtual-time-budget=4000", "--dump-dom", page.as_uri()],
        capture_output=True, text=True, timeout=120, check=True)  # fmt: skip
    assert re.findall(r'<pre id="probe">(.*?)</pre>', done.stdout)[-1] == "ready,true,true", done.stderr[-2000:]
    assert "CONSOLE" not in done.stderr
