"""`muybridge calibrate points` and `world`: the linear solution, uncertainties, degenerate layouts."""

import re

import numpy as np
import pytest

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration import load_calibration, save_calibration
from muybridge.geometry.calibration.resection import KnownPoints, calibrate_points, layout, linear_camera
from muybridge.geometry.calibration.world import check_shape, on_points, transform_cameras
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.numerics.rotations import exp_so3
from muybridge.infer.commands.app import run_command
from muybridge.infer.pipelines.calibration.known_points import read_points
from muybridge.infer.pipelines.calibration.world import world_from_landmarks
from tests.rigs import look_at

SIZE = (1280, 720)


def camera(k, model="OPENCV", bend=-0.2):
    angle = 1.3 * k
    lens = {"PINHOLE": (1000.0, 990.0, 650.0, 350.0), "OPENCV": (1000.0, 1000.0, 650.0, 350.0, bend, 0.05, 0.0, 0.0)}
    pose = look_at((3 * np.cos(angle), 3 * np.sin(angle), 1.6), (0, 0, 0))
    return Camera(f"c{k}", model, *SIZE, lens[model], pose)


def rig(count=4):
    return CameraGroup(tuple(camera(k) for k in range(count)))


def seen(c, rng, count, noise=0.5):
    points = rng.uniform(-0.8, 0.8, size=(1000, 3))
    px = c.project(points)
    inside = ((px > 0) & (px < np.array(SIZE) - 1)).all(axis=1)
    points = points[inside][:count]
    return KnownPoints(points, c.project(points) + rng.normal(size=(len(points), 2)) * noise)


def sizes(cameras):
    return {c.name: SIZE for c in cameras}


@pytest.mark.parametrize("count", [6, 20])
def test_the_linear_solution_is_exact_without_noise(count):
    rng = np.random.default_rng(0)
    truth = camera(1, "PINHOLE")
    for shift in (0.0, 100.0):  # a world whose origin is far away
        known = seen(truth, rng, count, 0.0)
        matrix, pose = linear_camera(known.points + shift, known.pixels)
        np.testing.assert_allclose(matrix, truth.camera_matrix, rtol=1e-5, atol=1e-3)
        np.testing.assert_allclose(pose[:, :3], truth.rotation, atol=1e-6)
        np.testing.assert_allclose(-pose[:, :3].T @ pose[:, 3] - shift, truth.center_world, atol=1e-4)
    with pytest.raises(ValueError, match="6 points are needed, not 5"):
        linear_camera(known.points[:5], known.pixels[:5])


def test_the_rotation_is_one_also_with_noise():
    rng = np.random.default_rng(1)
    known = seen(camera(0, "PINHOLE"), rng, 10, 3.0)
    _, pose = linear_camera(known.points, known.pixels)
    np.testing.assert_allclose(pose[:, :3] @ pose[:, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(pose[:, :3]) == pytest.approx(1)


@pytest.mark.parametrize("count", [7, 12, 60])
def test_cameras_with_distortion_lie_within_their_uncertainty(count):
    rng = np.random.default_rng(count)
    truth, ratios = rig(), []
    for _ in range(5):
        result = calibrate_points({c.name: seen(c, rng, count) for c in truth}, sizes(truth), sigma_px=0.5).solved
        off = np.linalg.norm(result.cameras.centers_world - truth.centers_world, axis=1)
        ratios += list(off / result.position_std)
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 2
    if count == 60:
        assert off.max() < 0.03
        for found, true in zip(result.cameras, truth, strict=True):
            assert found.params[4] == pytest.approx(true.params[4], abs=0.05)


def test_a_wrong_point_is_reported_and_has_little_weight():
    rng = np.random.default_rng(3)
    c = camera(0)
    known = seen(c, rng, 20)
    known.pixels[5] += [50, -30]
    result = calibrate_points({"c0": known}, sizes([c]), sigma_px=0.5)
    x, y, z = known.points[5]
    assert any(f"({x:g}, {y:g}, {z:g})" in note for note in result.notes)
    assert np.linalg.norm(result.solved.cameras[0].center_world - c.center_world) < 0.08


@pytest.mark.parametrize("count", [4, 6, 30])
@pytest.mark.parametrize("flat", [False, True])
def test_fewer_points_suffice_with_known_lenses(count, flat):
    rng = np.random.default_rng(4)
    truth = rig(2)
    known = {}
    for c in truth:
        mine = seen(c, rng, count)
        if flat:
            mine.points[:, 2] = 0
            mine.pixels[:] = c.project(mine.points) + rng.normal(size=mine.pixels.shape) * 0.5
        known[c.name] = mine
    if count == 30:
        known["c1"].pixels[[3, 9]] += 80
    result = calibrate_points(known, sizes(truth), truth, sigma_px=0.5).solved
    off = np.linalg.norm(result.cameras.centers_world - truth.centers_world, axis=1)
    assert (off < 4 * result.position_std).all() and off.max() < 0.1
    assert result.cameras[0].params == truth[0].params


def test_degenerate_layouts_are_refused():
    rng = np.random.default_rng(5)
    c = camera(0)
    flat = rng.uniform(-0.5, 0.5, size=(12, 3)) * [1, 1, 0]
    line = np.linspace(-0.5, 0.5, 12)[:, None] * [1.0, 0.5, 0.2]
    assert (layout(flat), layout(line), layout(rng.normal(size=(8, 3)))) == ("plane", "line", "space")
    cases = [
        (flat, None, "camera c0: all 12 points lie in a plane.*focal length and distance.*off the plane"),
        (line, None, "camera c0: all 12 points lie on a line"),
        (line, CameraGroup((c,)), "lie on a line, about which the camera could turn"),
        (rng.normal(size=(5, 3)) * 0.3, None, "5 points, at least 6 .* in lenses"),
        (flat[:3], CameraGroup((c,)), "3 points, at least 4 .* up to four places fit"),
    ]
    for points, lenses, message in cases:
        with pytest.raises(CalibrationError, match=message):
            calibrate_points({"c0": KnownPoints(points, c.project(points))}, sizes([c]), lenses)


def test_permuted_points_are_refused_or_reported():
    rng = np.random.default_rng(6)
    c = camera(0)
    known = seen(c, rng, 12)
    mixed = KnownPoints(known.points, rng.permutation(known.pixels))
    try:
        result = calibrate_points({"c0": mixed}, sizes([c]))
    except CalibrationError as error:
        assert "order of the coordinates" in str(error)
    else:
        assert result.notes


def table(path, cameras, points, rng, noise=0.5, header="camera,x,y,z,u,v"):
    rows = [header]
    for c in cameras:
        for x, px in zip(points, c.project(points) + rng.normal(size=(len(points), 2)) * noise, strict=True):
            rows.append(",".join([c.name, *(f"{v:.5f}" for v in (*x, *px))]))
    path.write_text("\n".join(rows) + "\n")
    return path


def failed(capfd, *arguments):
    assert run_command(["calibrate", *map(str, arguments)]) == 2
    return capfd.readouterr().err


def test_points_from_a_table(tmp_path, capfd):
    rng = np.random.default_rng(7)
    truth, points = rig(3), rng.uniform(-0.5, 0.5, size=(15, 3))
    path, out = table(tmp_path / "p.csv", truth, points, rng), tmp_path / "c.toml"
    base = ["points", path, "--out", out]
    assert run_command(["calibrate", *map(str, base), "--size", "1280", "720"]) == 0
    assert "+-" in capfd.readouterr().out
    found = load_calibration(out)
    assert np.linalg.norm(found.centers_world - truth.centers_world, axis=1).max() < 0.2
    save_calibration(truth, tmp_path / "lenses.toml")
    assert run_command(["calibrate", *map(str, base), "--lenses", str(tmp_path / "lenses.toml")]) == 0
    assert "(held)" in capfd.readouterr().out
    assert np.linalg.norm(load_calibration(out).centers_world - truth.centers_world, axis=1).max() < 0.02
    assert "--size WIDTH HEIGHT" in failed(capfd, *base)
    assert "outside its 640 x 480 image" in failed(capfd, *base, "--size", 640, 480)


@pytest.mark.parametrize("count", [7, 15])
def test_points_that_are_mirrored_are_refused_with_what_would_fit(count):
    rng = np.random.default_rng(11)
    truth = rig(3)
    known = {c.name: seen(c, rng, count) for c in truth}
    below = {n: KnownPoints(k.points, [0, 719] + k.pixels * [1, -1]) for n, k in known.items()}
    left = {n: KnownPoints(k.points * [1, -1, 1], k.pixels) for n, k in known.items()}
    swapped = {n: KnownPoints(k.points[:, [0, 2, 1]], k.pixels) for n, k in known.items()}
    for lenses in (None, truth):
        for wrong, message in (
            (below, "v counted from the top"),
            (left, "sign of y changed"),
            (swapped, "y and z swap"),
        ):
            with pytest.raises(CalibrationError, match=f"do not fit .* but they do .* with .*{message}"):
                calibrate_points(wrong, sizes(truth), lenses)


def test_points_that_fit_no_camera_are_refused_and_the_camera_is_reported():
    rng = np.random.default_rng(12)
    truth = rig(3)
    known = {c.name: seen(c, rng, 12) for c in truth}
    mixed = {n: KnownPoints(k.points, rng.permutation(k.pixels)) for n, k in known.items()}
    with pytest.raises(CalibrationError, match="the points fit no camera .* a point and its own pixel"):
        calibrate_points(mixed, sizes(truth), truth)
    notes = calibrate_points(known | {"c1": mixed["c1"]}, sizes(truth), truth).notes
    assert [n for n in notes if "fit it at all" in n] == [n for n in notes if "camera c1" in n] != []


def test_points_in_millimetres_are_reported(tmp_path, capfd):
    rng = np.random.default_rng(13)
    truth = CameraGroup(tuple(
        c.posed(np.column_stack([c.rotation, c.translation * 1000])) for c in rig(3)
    ))  # fmt: skip
    path = table(tmp_path / "p.csv", truth, rng.uniform(-500, 500, size=(15, 3)), rng)
    run = ["calibrate", "points", str(path), "--out", str(tmp_path / "c.toml"), "--size", "1280", "720"]
    assert run_command(run) == 0
    assert "m apart: the points' coordinates must be in metres; are they in millimetres?" in capfd.readouterr().out
    save_calibration(rig(3), tmp_path / "old.toml")
    world = ["calibrate", "world", str(tmp_path / "old.toml"), "--points", str(path), "--out", str(tmp_path / "n.toml")]
    assert run_command(world) == 0
    assert "must be in metres" in capfd.readouterr().out


@pytest.mark.parametrize("between", [",", ";", "\t"])
def test_tables_with_other_separators(tmp_path, between):
    path = tmp_path / "p.csv"
    lines = ["camera,x,y,z,u,v", "c0,1.5,2,-3.25,4,5.5", "c0,1,2,3,,", "c 1,0.5,0,0,1,2"]
    path.write_text("\n".join(lines).replace(",", between))
    found = read_points(path)
    assert list(found) == ["c0", "c 1"]
    np.testing.assert_array_equal(found["c0"].points, [[1.5, 2, -3.25]])
    np.testing.assert_array_equal(found["c0"].pixels, [[4, 5.5]])
    if between == ";":
        path.write_text(path.read_text().replace(".", ","))
        np.testing.assert_array_equal(read_points(path)["c0"].points, [[1.5, 2, -3.25]])


def test_invalid_tables(tmp_path):
    path = tmp_path / "p.csv"
    for text, message in (
        ("camera,x,y,z,u\n", "no column v; its first line must name camera, x, y, z, u, v"),
        ("camera,x,y,z,u,v\nc0,1,2,3,4,five\n", "line 2: v is 'five', not a number"),
        ("camera,x,y,z,u,v\nc0,1,,3,4,5\n", "line 2: y is '', not a number"),
        ("camera,x,y,z,u,v\n", "no rows"),
    ):
        path.write_text(text)
        with pytest.raises(CalibrationError, match=message):
            read_points(path)
    path.write_text("Camera, X, Y, Z, U, V\nc0, 1, 2, 3, 4, 5\nc0, 1, 2, 3, ,\n")
    assert len(read_points(path)["c0"].points) == 1
    with pytest.raises(CalibrationError, match="cannot be read"):
        read_points(tmp_path / "none.csv")


def elsewhere(cameras):
    """The cameras in another world, half the size; and that world."""
    turn = exp_so3(np.array([0.4, -1.0, 0.3]))
    return transform_cameras(cameras, np.column_stack([turn, [1.0, 2, 3]]), 0.5)


def test_a_world_from_marked_points(tmp_path, capfd):
    rng = np.random.default_rng(8)
    truth = rig()
    points = np.array([[0, 0, 0], [0.6, 0, 0], [0, 0.6, 0], [0.3, 0.3, 0.4]])
    old, out = tmp_path / "old.toml", tmp_path / "new.toml"
    save_calibration(elsewhere(truth), old)
    path = table(tmp_path / "p.csv", truth, points, rng)
    assert run_command(["calibrate", "world", str(old), "--points", str(path), "--out", str(out)]) == 0
    assert "times as large" in capfd.readouterr().out
    found = load_calibration(out)
    assert np.linalg.norm(found.centers_world - truth.centers_world, axis=1).max() < 0.03
    again = tmp_path / "again.toml"
    by_hand = ["--turn-deg", "90", "--origin", "0", "0", "0.6", "--scale-by", "2"]
    assert run_command(["calibrate", "world", str(out), "--out", str(again), *by_hand]) == 0
    x, y, z = found[0].center_world
    np.testing.assert_allclose(load_calibration(again)[0].center_world, [2 * y, -2 * x, 2 * (z - 0.6)], atol=1e-9)
    assert "give one of --points" in failed(capfd, "world", out, "--out", again)
    line = table(tmp_path / "line.csv", truth, points[:1] + np.linspace(0, 1, 4)[:, None] * [0.5, 0, 0], rng)
    assert "lie on a line" in failed(capfd, "world", old, "--points", line, "--out", again)
    once = table(tmp_path / "once.csv", truth.select(["c1"]), points, rng)
    assert "0 of the 4 points are seen by two cameras" in failed(capfd, "world", old, "--points", once, "--out", again)
    other = table(tmp_path / "other.csv", [truth[0].renamed("x")], points, rng)
    assert "no camera x in the calibration" in failed(capfd, "world", old, "--points", other, "--out", again)
    left = table(tmp_path / "left.csv", truth, points, rng)
    left.write_text(re.sub(r"^(c\d,[^,]*),", r"\1,-", left.read_text(), flags=re.M).replace("--", ""))
    none = tmp_path / "none.toml"
    assert "left.csv: the points are up to" in failed(capfd, "world", old, "--points", left, "--out", none)
    assert not none.exists()


@pytest.mark.parametrize("count", [4, 5, 9])
def test_wrong_and_mirrored_points_of_a_world_are_reported(count):
    rng = np.random.default_rng(14)
    known = rng.uniform(-1, 1, size=(count, 3))
    found = 0.5 * known @ exp_so3(np.array([0.4, -1.0, 0.3])).T + [1.0, 2, 3] + rng.normal(size=known.shape) * 1e-3
    found = np.concatenate([found, np.full((1, 3), np.nan)])
    known = np.concatenate([known, np.zeros((1, 3))])
    check_shape(found, known)
    x, y, z = known[1] = known[1] + [0.6, 0.2, 0.0]
    with pytest.raises(CalibrationError, match=rf"without \({x:g}, {y:g}, {z:g}\) the others fit to [0-9] mm: check"):
        check_shape(found, known)
    known[1] -= [0.6, 0.2, 0.0]
    for wrong in (known * [1, -1, 1], known[:, [0, 2, 1]]):
        with pytest.raises(CalibrationError, match="sign of y changed: their axes are left-handed"):
            check_shape(found, wrong)
    with pytest.raises(CalibrationError, match="each row has a point and its own pixel"):
        check_shape(found, np.roll(known[:count], 1, axis=0)[[*range(count), 0]])


def test_points_determine_the_scale_only_if_requested():
    truth, points = rig(), np.array([[0, 0, 0], [0.6, 0, 0], [0, 0.6, 0], [0.3, 0.3, 0.4]])
    pixels = truth.project(points)
    pixels[2, 1] = np.nan
    placed = on_points(elsewhere(truth), pixels, points)
    assert placed.scale == pytest.approx(2) and placed.errors.max() < 1e-6
    kept = on_points(elsewhere(truth), pixels, points, keep_scale=True)
    assert kept.scale == 1 and kept.errors.max() > 0.1


def test_a_world_from_people():
    truth = rig()
    heights = {"shoulder": 1.407, "hip": 0.912, "knee": 0.491, "ankle": 0.07, "heel": 0.03, "big_toe": 0.02}
    names = [f"{side}_{part}" for part in heights for side in ("left", "right")]
    body = np.array([(0.1 * (-1) ** k, 0.0, heights[n.split("_", 1)[1]]) for k, n in enumerate(names)])
    rng = np.random.default_rng(9)
    points = body + np.append(rng.uniform(-1.5, 1.5, size=2), 0) + np.zeros((200, 1, 3))
    points = points + np.concatenate([rng.uniform(-1.5, 1.5, size=(200, 2)), np.zeros((200, 1))], axis=1)[:, None]
    turn = exp_so3(np.array([0.4, -1.0, 0.3]))
    there = 0.5 * points @ turn.T + [1.0, 2, 3]
    found, message = world_from_landmarks(elsewhere(truth), there, names, 1.72)
    np.testing.assert_allclose(found.centers_world[:, 2], truth.centers_world[:, 2], atol=0.06)
    assert any("times as large" in line for line in message)
    kept, message = world_from_landmarks(elsewhere(truth), there, names, None)
    apart = np.linalg.norm(kept.centers_world[1] - kept.centers_world[0])
    assert apart == pytest.approx(0.5 * np.linalg.norm(truth.centers_world[1] - truth.centers_world[0]), rel=1e-9)
    assert "size: kept" in message
