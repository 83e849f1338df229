"""The report: its figures find what was put wrong, and its page works in a browser without a network."""

import json
import re
from dataclasses import replace
from pathlib import Path

import markupsafe
import numpy as np
import pytest

from muybridge.errors import OutputError
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.infer.report.data import ReportData, Thumbnail
from muybridge.infer.report.figures import (
    BoneFigures,
    bone_figures,
    camera_figures,
    coverage,
    gaps,
    headline,
    jumps,
    timeline,
)
from muybridge.infer.report.findings import findings, verdict
from muybridge.infer.report.page import pick_thumbnail_frames, problems, render_report, write_report
from tests.rigs import ring_of_cameras

J = len(BODY23)
FPS = 60.0

# A standing body, metres, the subject's left is +X, facing -Y; one side, mirrored below.
_LEFT = {
    "eye": (0.03, -0.09, 1.62), "ear": (0.08, 0.0, 1.62), "shoulder": (0.19, 0.0, 1.42),
    "elbow": (0.27, 0.02, 1.13), "wrist": (0.30, -0.08, 0.88), "hip": (0.11, 0.0, 0.92),
    "knee": (0.12, -0.03, 0.50), "ankle": (0.12, 0.02, 0.08), "big_toe": (0.12, -0.18, 0.02),
    "small_toe": (0.18, -0.15, 0.02), "heel": (0.12, 0.06, 0.03),
}  # fmt: skip


def _body() -> np.ndarray:
    """(J, 3) standing body."""
    points = {"nose": (0.0, -0.12, 1.58)}
    for part, (x, y, z) in _LEFT.items():
        points[f"left_{part}"], points[f"right_{part}"] = (x, y, z), (-x, y, z)
    return np.array([points[name] for name in BODY23.names])


def _rig(count: int = 4) -> CameraGroup:
    """Cameras on a ring of 4 m, 1.5 m up, looking at the body."""
    return ring_of_cameras(
        [f"cam{c + 1:02d}" for c in range(count)],
        target=(0, 0, 0.9),
        angles=[2 * np.pi * (c + 0.3) / count for c in range(count)],
        size=(1280, 960),
        focal=1200.0,
    )


def _walk(frames: int) -> np.ndarray:
    """(T, J, 3) the body sways a metre to and fro and swings its limbs."""
    phase = 2 * np.pi * np.arange(frames) / 60.0
    body = np.repeat(_body()[None], frames, axis=0)
    body[:, :, 1] += (0.6 * np.sin(phase))[:, None]
    body[:, :, 0] += (0.3 * np.cos(0.7 * phase))[:, None]
    return body


def _take(frames: int = 120, noise_px: float = 1.0, seed: int = 0) -> tuple[CameraGroup, np.ndarray, Points3D]:
    """A rig, its 2D points (C, T, J, 2) and 3D points whose residuals belong to them."""
    rig, world = _rig(), _walk(frames)
    noise = np.random.default_rng(seed).normal(0.0, noise_px, (len(rig), frames, J, 2))
    px = rig.project(world) + noise
    return rig, px, _points(rig, px, world)


def _points(rig: CameraGroup, px: np.ndarray, world: np.ndarray) -> Points3D:
    residual = np.linalg.norm(px - rig.project(world), axis=-1)
    covariance = np.broadcast_to(np.eye(3) * 1e-4, (*world.shape, 3)).copy()
    return Points3D(BODY23, world, covariance, residual, np.isfinite(residual), FPS)


def _data(**changes: object) -> ReportData:
    rig, px, points = _take()
    return replace(ReportData(title="walk", cameras=rig, points=points, keypoints_px=px), **changes)


def _texts(rig: CameraGroup, px: np.ndarray | None, points: Points3D) -> str:
    figures = camera_figures(rig, points, px, None)
    return "\n".join(f.text for f in findings(points, figures, bone_figures(points)))


# ---- figures


def test_a_good_take_has_no_findings() -> None:
    rig, px, points = _take()
    loo = points.residual_px * 1.3
    figures = headline(rig, points, points, loo)
    assert figures.coverage == 1.0
    # Rayleigh: the median length of a 2D Gaussian of 1 px is 1.177 px.
    assert figures.residual_px == pytest.approx(1.177, rel=0.03)
    assert figures.leave_one_out_px == pytest.approx(1.3 * 1.177, rel=0.03)
    bones = bone_figures(points)
    assert verdict(figures, bones)[0] == "good"
    # Two cameras agree on any depth: what tells is a shoulder width that varies.
    assert verdict(figures, [*bones, BoneFigures("left shoulder to right shoulder", 0.29, 0.07, 3, -1)])[0] == "fair"
    rating, sentence = verdict(figures, [*bones, BoneFigures("left hip to right hip", 0.2, 0.08, 3, -1)])
    assert rating == "poor" and "left hip to right hip changes its length by ±40 %" in sentence
    assert _texts(rig, px, points) == ""


@pytest.mark.parametrize(("scale", "said"), [(0.1, "0.1"), (39.37, "m tall"), (0.6, ""), (1.2, "")])
def test_a_person_of_impossible_size(scale: float, said: str) -> None:
    rig, px, points = _take()
    points = replace(points, points_world=scale * points.points_world)
    data = ReportData(title="walk", cameras=rig, points=points, keypoints_px=px)
    assert any("m tall" in text and said in text for text in problems(data)) == bool(said)


def test_millimetres_at_the_person() -> None:
    rig, px, points = _take()
    for camera in camera_figures(rig, points, px, None):
        assert camera.mm_per_px == pytest.approx(1000 * 4.0 / 1200, rel=0.08)


def test_a_constant_shift_is_attributed_to_the_calibration() -> None:
    rig, px, points = _take()
    px[2] += [9.0, 0.5]
    points = _points(rig, px, points.points_world)
    figures = camera_figures(rig, points, px, None)
    np.testing.assert_allclose(figures[2].bias_px, [9.0, 0.5], atol=0.2)
    text = _texts(rig, px, points)
    assert "cam03 by 9 px (right)" in text and "calibration" in text
    assert "cam01 by" not in text


@pytest.mark.parametrize("lag", [-2, 1, 3])
def test_an_unsynchronised_camera_is_named_with_its_lag(lag: int) -> None:
    rig, world = _rig(), _walk(140)
    px = rig.project(world)[:, 10:130]
    px[1] = rig["cam02"].project(world[10 + lag : 130 + lag])
    px += np.random.default_rng(1).normal(0.0, 1.0, px.shape)
    # The 3D points are a mean over the cameras: a quarter of the lag is in them.
    points = _points(rig, px, 0.75 * world[10:130] + 0.25 * world[10 + lag : 130 + lag])
    figures = camera_figures(rig, points, px, None)
    assert figures[1].lag_frames == pytest.approx(lag, abs=0.35)
    text = _texts(rig, px, points)
    assert f"cam02 seems to run about {abs(figures[1].lag_frames):.1f} frames" in text
    assert ("ahead of" if lag > 0 else "behind") in text
    assert "cam01 seems" not in text and "cam03 seems" not in text


def test_left_right_flips_are_found_in_their_camera_and_frames() -> None:
    rig, px, points = _take()
    mirror = list(BODY23.mirror)
    px[0, 40:60] = px[0, 40:60][:, mirror]
    points = _points(rig, px, points.points_world)
    figures = camera_figures(rig, points, px, None)
    assert figures[0].flipped > 0.1 and 40 <= figures[0].flipped_frame < 60
    assert all(f.flipped == 0 for f in figures[1:])
    assert "cam01 takes left for right" in _texts(rig, px, points)


def test_gaps_are_listed_longest_first() -> None:
    rig, px, points = _take()
    world = points.points_world.copy()
    world[30:50, BODY23.index("left_wrist")] = np.nan
    world[100:103, BODY23.index("nose")] = np.nan
    world[119, BODY23.index("nose")] = np.nan
    points = replace(points, points_world=world)
    found = gaps(points)
    assert [(BODY23.names[g.landmark], g.first, g.last) for g in found] == [
        ("left_wrist", 30, 49), ("nose", 100, 102), ("nose", 119, 119),
    ]  # fmt: skip
    assert coverage(points) == pytest.approx(1 - 24 / (120 * J))
    text = _texts(rig, px, points)
    assert "Left wrist is missing in frames 30 to 49 (0.33 s)." in text
    assert "2 more, shorter gaps" in text


def test_frames_without_people_are_reported_once() -> None:
    rig, px, points = _take()
    world = points.points_world.copy()
    world[10:40] = np.nan
    text = _texts(rig, px, replace(points, points_world=world))
    assert "In 30 of 120 frames there is no 3D point at all, first in frame 10." in text
    assert "Nose is missing" not in text


def test_varying_bones_and_unequal_sides_are_named() -> None:
    rig, px, points = _take()
    world = points.points_world.copy()
    world[::2, BODY23.index("left_wrist")] += [0.0, 0.0, 0.1]
    world[:, BODY23.index("right_knee")] += [0.0, 0.0, 0.12]
    text = _texts(rig, px, replace(points, points_world=world))
    assert "The bone left elbow to wrist changes its length" in text
    assert "Left and right differ from hip to knee" in text
    bones = {b.name: b for b in bone_figures(points)}
    expected = np.linalg.norm(np.subtract(_LEFT["knee"], _LEFT["ankle"]))
    assert bones["left knee to ankle"].median_m == pytest.approx(expected)
    assert bones["left knee to ankle"].spread_m == pytest.approx(0, abs=1e-9)


def test_a_jump_is_found_in_its_frame() -> None:
    _, _, points = _take()
    world = points.points_world.copy()
    world[70, BODY23.index("right_heel")] += [0.0, 0.5, 0.0]
    found = jumps(replace(points, points_world=world))
    assert {(BODY23.names[j], t) for _, j, t in found} == {("right_heel", 70), ("right_heel", 71)}


def test_blind_and_rejected_cameras_are_named() -> None:
    rig, px, points = _take()
    px[3] = np.nan
    inlier = points.inlier.copy()
    inlier[0, :60] = False
    points = replace(_points(rig, px, points.points_world), inlier=inlier)
    text = _texts(rig, px, points)
    assert "cam04 found the person in no frame" in text
    assert "50 % of the 2D points of cam01 took no part" in text


@pytest.mark.parametrize("columns", [7, 120, 1000])
def test_timeline_keeps_totals(columns: int) -> None:
    _, _, points = _take()
    world = points.points_world.copy()
    world[30:50, 3] = np.nan
    points = replace(points, points_world=world)
    line = timeline(points, columns)
    assert len(line.first_frame) == min(columns, 120)
    widths = np.diff([*line.first_frame, 120])
    np.testing.assert_allclose((line.missing * widths[:, None]).sum(axis=0), np.where(np.arange(J) == 3, 20, 0))
    assert np.nanmax(line.cameras) == 4 and line.residual_px.shape == (len(widths), 4)


def test_an_empty_take_is_reported() -> None:
    rig, px, points = _take(5)
    empty = _points(rig, np.full_like(px, np.nan), np.full_like(points.points_world, np.nan))
    page = render_report(ReportData(title="empty", cameras=rig, points=empty, keypoints_px=np.full_like(px, np.nan)))
    assert "No landmark has a 3D position in any frame" in page
    assert not re.search(r"\bnan\b", page, re.IGNORECASE)


def test_thumbnail_frames_include_the_worst() -> None:
    _, _, points = _take()
    residual = points.residual_px.copy()
    residual[:, 97] += 50
    chosen = pick_thumbnail_frames(replace(points, residual_px=residual), 3)
    assert 97 in chosen and len(chosen) <= 3 and list(chosen) == sorted(chosen)
    assert list(pick_thumbnail_frames(_take(1)[2], 4)) == [0]


# ---- page


def _scene(page: str) -> dict:
    return json.loads(re.search(r'id="data">(.*?)</script>', page, re.S).group(1))


def test_page_is_self_contained() -> None:
    page = render_report(_data(thumbnails=(Thumbnail("cam01", 3, b"\xff\xd8jpeg"),)))
    assert "default-src 'none'" in page
    # Nothing is loaded: no source but data, no link but to files beside the report.
    for attribute, value in re.findall(r'\b(src|href|srcset|action)="([^"]*)"', page):
        assert value.startswith("data:"), f"{attribute}={value}"
    assert not re.search(r"https?://|url\(|@import|<!--@|{{|{%", page)


def test_hostile_names_stay_text(tmp_path: Path) -> None:
    evil = '<script>alert("x")</script>&'
    data = _data(title=evil, person=evil, warnings=(evil,), options={"a": evil}, files=(evil,))
    cameras = tuple(replace(c, name=c.name + evil) for c in data.cameras)
    data = replace(data, cameras=CameraGroup(cameras), thumbnails=(Thumbnail(cameras[0].name, 1, b"j"),))
    page = render_report(data)
    assert "<script>alert" not in page
    assert page.count("</script>") == 2
    assert str(markupsafe.escape(evil)) in page
    assert _scene(page)["cameras"][0]["name"] == "cam01" + evil


def test_positions_survive_packing() -> None:
    import base64

    data = _data()
    world = data.points.points_world.copy()
    world[5, 7] = np.nan
    world[6, 8] = [900.0, 0.0, 0.0]  # one wild point must not cost the others their precision
    scene = _scene(render_report(replace(data, points=replace(data.points, points_world=world))))
    packed = scene["landmarks"]["positions"]
    codes = np.frombuffer(base64.b64decode(packed["data"]), "<i2").reshape(120, J, 3)
    decoded = np.where(codes == -32768, np.nan, codes * packed["step"] + packed["offset"])
    expected = world.copy()
    expected[6, 8] = np.nan
    np.testing.assert_allclose(decoded, expected, atol=2e-4)


def test_mismatched_arrays_are_refused() -> None:
    data = _data()
    with pytest.raises(ValueError, match="leave_one_out_px"):
        render_report(replace(data, leave_one_out_px=np.zeros((4, 7, J))))
    with pytest.raises(ValueError, match="joint_parents"):
        render_report(replace(data, joint_names=("a",)))


def test_the_report_is_written_atomically(tmp_path: Path) -> None:
    path = write_report(tmp_path / "report.html", _data())
    assert path.read_text(encoding="utf-8").rstrip().endswith("</html>")
    assert [p.name for p in tmp_path.iterdir()] == ["report.html"]
    (tmp_path / "absent").write_text("a file, not a folder")
    with pytest.raises(OutputError, match=r"absent.*choose a folder"):
        write_report(tmp_path / "absent" / "report.html", _data())


# ---- browser

# What a reader does: every control, keys, mouse, touch and wheel; then what the page says is written down.
_EXERCISE = """
<script>
const said = [];
addEventListener("error", (e) => said.push("error: " + e.message));
addEventListener("unhandledrejection", (e) => said.push("rejection: " + e.reason));
addEventListener("securitypolicyviolation", (e) => said.push("policy: " + e.blockedURI));
addEventListener("load", () => {
  const byId = (id) => document.getElementById(id), view = byId("view"), out = {};
  const hud = () => byId("hud").textContent.split("\\n")[0];
  const painted = (id) => {
    const copy = document.createElement("canvas"), source = byId(id);
    copy.width = 200; copy.height = 150;
    const g = copy.getContext("2d", { willReadFrequently: true });
    g.drawImage(source, 0, 0, 200, 150);
    return g.getImageData(0, 0, 200, 150).data.reduce((sum, v, i) => sum + (i % 4 === 3 && v > 0), 0);
  };
  out.start = hud();
  const scrub = byId("scrub");
  scrub.value = 17; scrub.dispatchEvent(new Event("input"));
  out.scrubbed = hud();
  for (const key of ["ArrowRight", "ArrowRight", "ArrowLeft"])
    view.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
  out.stepped = hud();
  const jump = document.querySelector(".jump");
  out.wanted = Number(jump.dataset.frame); jump.click(); out.jumped = hud();
  for (const key of ["w", "a", "s", "d", "+", "-", "0", " ", " ", "Home", "End"])
    view.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
  out.last = hud();
  const at = (type, x, y, id, buttons) => view.dispatchEvent(
    new PointerEvent(type, { pointerId: id, clientX: x, clientY: y, buttons, bubbles: true }));
  view.setPointerCapture = () => {};
  at("pointerdown", 200, 200, 1, 1); at("pointermove", 260, 220, 1, 1);
  at("pointerdown", 300, 200, 2, 1); at("pointermove", 340, 210, 2, 1);
  at("pointerup", 340, 210, 2, 0); at("pointermove", 250, 240, 1, 2); at("pointerup", 250, 240, 1, 0);
  view.dispatchEvent(new WheelEvent("wheel", { deltaY: 120, cancelable: true }));
  view.dispatchEvent(new MouseEvent("dblclick"));
  for (const box of document.querySelectorAll("fieldset input")) box.click();
  const from = byId("from");
  out.views = [...from.options].map((option) => {
    from.value = option.value; from.dispatchEvent(new Event("change"));
    return [option.text, painted("view") > 500];
  });
  out.timeline = painted("timeline") > 500;
  dispatchEvent(new Event("beforeprint")); dispatchEvent(new Event("afterprint"));
  const scene = JSON.parse(byId("data").textContent), fresh = new View(view, scene);
  fresh.through = 2;
  const hole = fresh.pinhole(1000, 800), box = fresh.frame;
  out.projected = fresh.landmarks.track.frame(17).map((p) => fresh.toPixel(hole, fresh.toEye(hole, p)))
    .map((q) => [(q[0] - box[0]) / box[2], (q[1] - box[1]) / box[3]]);
  out.requests = performance.getEntriesByType("resource").map((e) => e.name)
    .filter((name) => !name.startsWith("data:"));
  out.wide = document.documentElement.scrollWidth - innerWidth;
  out.ready = document.documentElement.dataset.ready;
  out.said = said;
  const pre = document.createElement("pre");
  pre.id = "probe"; pre.textContent = JSON.stringify(out);
  document.body.append(pre);
});
</script>
"""

_CHROMIUM_FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--hide-scrollbars",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--host-resolver-rules=MAP * ~NOTFOUND", "--virtual-time-budget=4000", "--enable-logging=stderr",
)  # fmt: skip
