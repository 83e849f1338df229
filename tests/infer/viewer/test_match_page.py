"""The page of `muybridge match play`: its data decode to what Python has, and keys steer the figure in a browser."""

import html
import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import OutputError
from muybridge.infer.commands.motion.match import play
from muybridge.infer.viewer.match_page import PageOptions, pack_database, pack_turns, render_match_page, thinned
from muybridge.infer.viewer.page import read_asset
from muybridge.motion.matching import MatchDatabase, build_database, write_database
from tests.infer.viewer.test_viewer import array, embedded, places
from tests.motion.matching.walks import walks


@pytest.fixture(scope="module")
def database() -> MatchDatabase:
    return build_database(*walks()).database


def test_poses_and_features_decode_to_those_of_python(database: MatchDatabase) -> None:
    packed = pack_database(database, "walks", PageOptions())
    shape = database.features.shape
    codes = array(packed["features"]["data"], "<u2").reshape(shape)
    scaled = np.array(packed["features"]["low"]) + np.array(packed["features"]["step"]) * codes
    assert np.abs(scaled - database.scaled).max() < 1e-3
    local = places(packed["roots"], (len(database), 3))
    c, s = np.cos(database.path.yaw), np.sin(database.path.yaw)
    world = database.path.places + np.stack(
        [c * local[:, 0] - s * local[:, 1], s * local[:, 0] + c * local[:, 1]], axis=1
    )
    assert np.abs(world - database.motion.root_positions_world[:, :2]).max() < 1e-3
    found = [k for a, b in packed["searchable"] for k in range(a, b)]
    assert found == np.flatnonzero(database.searchable).tolist()


def test_turns_decode_to_within_a_hundredth_of_a_degree() -> None:
    quat = np.random.default_rng(0).normal(size=(500, 3, 4))
    quat /= np.linalg.norm(quat, axis=-1, keepdims=True)
    codes = array(pack_turns(quat), "<u2").reshape(500, 3, 3).astype(int)
    largest = (codes[..., 0] >> 15) + 2 * (codes[..., 1] >> 15)
    rest = ((codes & 32767) / 32767 * 2 - 1) * np.sqrt(0.5)
    back = np.empty_like(quat)
    for index in np.ndindex(500, 3):
        w = np.sqrt(1 - (rest[index] ** 2).sum())
        back[index] = np.insert(rest[index], largest[index], w)
    degrees = 2 * np.degrees(np.arccos(np.clip(np.abs((back * quat).sum(axis=-1)), 0, 1)))
    assert degrees.max() < 0.01


def test_the_page_holds_fewer_frames(database: MatchDatabase) -> None:
    half = thinned(database, 30)
    assert half.fps == 30 and len(half) == 5 * 121 and half.names == database.names
    np.testing.assert_array_equal(half.features[121], database.features[241])
    assert thinned(database, 60) is database and thinned(database, 25).fps == 20


def test_page_asks_for_nothing_elsewhere_and_names_cannot_close_its_script(database: MatchDatabase) -> None:
    page = render_match_page(database, "</script><b>@@data@@")
    assert "</script><b>" not in page and embedded(page)["name"] == "</script><b>@@data@@"
    for name in ("steering.html", "steering.css", "matching.js", "steering.js", "camera.js"):
        assert not re.search(r"https?://|\bfetch\(|@import|<link rel=.style|src=", read_asset(name))


def test_play_replaces_its_own_page_alone(database: MatchDatabase, tmp_path: Path) -> None:
    path, page = tmp_path / "walks.match", tmp_path / "walks.html"
    write_database(path, database)
    assert play(path) == 0 and play(path) == 0
    page.write_text("mine")
    with pytest.raises(OutputError, match="was not made by muybridge"):
        play(path)
    assert page.read_text() == "mine" and play(path, overwrite=True) == 0


# Keys are held for two seconds each. Time is the steering's own: a browser without a screen draws when it likes.
_STEERING = """
<script>
window.said = [];
window.addEventListener("error", (e) => said.push(e.message));
window.addEventListener("load", async () => {
  const root = document.querySelector(".steering"), out = {};
  const wait = (ms) => new Promise((done) => setTimeout(done, ms));
  const key = (type, code) => document.dispatchEvent(new KeyboardEvent(type, { code, bubbles: true }));
  await wait(200);
  for (const code of ["ArrowUp", "ArrowRight"]) {
    const f = root.steering.figure, before = [...f.place];
    key("keydown", code); for (let k = 0; k < 120; k++) root.steering.advance(1 / 60);
    key("keyup", code);
    out[code] = [f.place[0] - before[0], f.place[1] - before[1], f.yaw];
  }
  const steering = root.steering, figure = steering.figure, clips = figure.clips;
  steering.walkAlong([0, 1, 2, 3].map((k) => [figure.place[0] + k, figure.place[1] + 0.5 * k]));
  steering.advance(1 / 60); out.path = steering.path !== null;
  // The tree against every frame, as JavaScript computes them.
  let same = 0;
  for (let k = 0; k < 200; k++) {
    const query = clips.scaled.slice(k * clips.width, (k + 1) * clips.width).map((v, i) => v + Math.sin(k + i));
    let best = Infinity;
    for (const [a, z] of clips.searchable) for (let t = a; t < z; t++) {
      let sum = 0;
      for (let f = 0; f < clips.width; f++) sum += (clips.scaled[t * clips.width + f] - query[f]) ** 2;
      best = Math.min(best, sum);
    }
    if (clips.tree.search(query)[1] === best) same++;
  }
  Object.assign(out, { same, said, jumps: figure.jumps, state: root.dataset.state,
    wide: document.documentElement.scrollWidth - innerWidth,
    message: root.querySelector("[data-part=message]").textContent });
  const probe = document.createElement("pre");
  probe.id = "probe"; probe.textContent = JSON.stringify(out); document.body.append(probe);
});
</script>
"""


@pytest.mark.slow
@pytest.mark.parametrize("size", [(1280, 800), (500, 844)], ids=["desktop", "phone"])
def test_keys_steer_the_figure_in_a_browser(database: MatchDatabase, tmp_path: Path, size: tuple[int, int]) -> None:
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("chromium is absent")
    page = tmp_path / "page.html"
    page.write_text(render_match_page(database, "walks").replace("<head>", "<head>" + _STEERING, 1), encoding="utf-8")
    done = subprocess.run(
        [chromium, "--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
         "--enable-logging=stderr", f"--user-data-dir={tmp_path / 'profile'}", f"--window-size={size[0]},{size[1]}",
         "--virtual-time-budget=8000", "--dump-dom", page.as_uri()],
        capture_output=True, text=True, timeout=180, check=True,
    )  # fmt: skip
    probe = re.search(r'<pre id="probe">(.*?)</pre>', done.stdout, re.S)
    assert probe, done.stderr[-2000:]
    out = json.loads(html.unescape(probe[1]))
    assert out["said"] == [] and out["message"] == "" and "CONSOLE" not in done.stderr, done.stderr[-2000:]
    assert out["state"] == "ready" and out["wide"] <= 0 and out["same"] == 200 and out["path"] and out["jumps"] > 0
    (_, up, _), (right, _, yaw) = out["ArrowUp"], out["ArrowRight"]
    assert up > 1 and right > 0.7
    assert abs(np.degrees(yaw)) < 35
