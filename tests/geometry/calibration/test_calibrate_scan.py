"""Fixed cameras in a scan of a room: a box with textured walls, ray traced through lenses."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from muybridge.errors import CalibrationError
from muybridge.geometry.calibration import load_calibration
from muybridge.geometry.calibration.structure_from_motion import ScanCalibration, ScanOptions, calibrate_scan
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.infer.commands.app import run_command
from tests.rigs import look_at

_HALF = np.array([2.6, 2.1])  # of the room, metres
_HEIGHT = 2.6
_PER_METRE = 160
_MARKER = 0.4


def _looking(name: str, at: tuple[float, float, float], to: tuple[float, float, float], params, size) -> Camera:
    return Camera(name, "SIMPLE_RADIAL", *size, params, look_at(at, to))


class Room:
    """Six textured planes; a marker lies on the floor about the origin, its top towards +Y."""

    def __init__(self, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        w, d, h = 2 * _HALF[0], 2 * _HALF[1], _HEIGHT
        self.planes = []  # a corner, two edges in the order of the texture's columns and rows, the texture
        for corner, across, down in (
            ((-w / 2, -d / 2, 0), (w, 0, 0), (0, d, 0)), ((-w / 2, -d / 2, h), (w, 0, 0), (0, d, 0)),
            ((-w / 2, -d / 2, h), (w, 0, 0), (0, 0, -h)), ((-w / 2, d / 2, h), (w, 0, 0), (0, 0, -h)),
            ((-w / 2, -d / 2, h), (0, d, 0), (0, 0, -h)), ((w / 2, -d / 2, h), (0, d, 0), (0, 0, -h)),
        ):  # fmt: skip
            columns, rows = (int(np.linalg.norm(e) * _PER_METRE) for e in (across, down))
            texture = np.zeros((rows, columns), np.float32)
            for size in (3, 9, 27):
                noise = rng.random((rows // size + 2, columns // size + 2)).astype(np.float32)
                texture += cv2.resize(noise, (columns, rows), interpolation=cv2.INTER_CUBIC)
            texture = np.clip((texture - 0.6) / 1.8 * 255, 0, 255)
            self.planes.append((np.array(corner), np.array(across, float), np.array(down, float), texture))
        floor = self.planes[0][3]
        side = int(_MARKER * _PER_METRE)
        quiet = side // 4
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        marker = cv2.aruco.generateImageMarker(dictionary, 7, side)
        top, left = floor.shape[0] // 2 - side // 2, floor.shape[1] // 2 - side // 2
        floor[top - quiet : top + side + quiet, left - quiet : left + side + quiet] = 255
        floor[top : top + side, left : left + side] = marker[::-1]  # the floor's rows run towards +Y

    def photograph(self, camera: Camera, rng: np.random.Generator) -> np.ndarray:
        """(H, W) what a camera in the room sees."""
        px = np.stack(np.meshgrid(np.arange(camera.width), np.arange(camera.height)), axis=-1).astype(float)
        rays = camera.rays(px)
        near = np.full(px.shape[:2], np.inf)
        image = np.zeros(px.shape[:2], np.float32)
        for corner, across, down, texture in self.planes:
            normal = np.cross(across, down)
            with np.errstate(divide="ignore", invalid="ignore"):
                depth = ((corner - camera.center_world) @ normal) / (rays @ normal)
            hit = camera.center_world + depth[..., None] * rays - corner
            u, v = hit @ across / (across @ across), hit @ down / (down @ down)
            inside = (depth > 1e-6) & (depth < near) & (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
            where = [(t * n - 0.5).astype(np.float32) for t, n in ((u, texture.shape[1]), (v, texture.shape[0]))]
            seen = cv2.remap(texture, *where, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            image[inside], near[inside] = seen[inside], depth[inside]
        return np.clip(image + rng.normal(0, 2.0, image.shape), 0, 255).astype(np.uint8)


def _scene(folder: Path, photos: int = 14) -> CameraGroup:
    """Photographs of a walk about the room and a still of each of three fixed cameras; the fixed cameras."""
    room, rng = Room(), np.random.default_rng(1)
    for part in ("scan", "fixed"):
        (folder / part).mkdir(parents=True)
    for k in range(photos):
        angle = 2 * np.pi * k / photos
        at = (1.5 * np.cos(angle), 1.1 * np.sin(angle), 1.5 + 0.2 * np.sin(3 * angle))
        to = (-1.2 * np.cos(angle + 0.3), -1.2 * np.sin(angle + 0.3), 0.35)
        phone = _looking("phone", at, to, (330.0, 239.5, 179.5, -0.03), (480, 360))
        cv2.imwrite(str(folder / "scan" / f"{k:03d}.png"), room.photograph(phone, rng))
    fixed = (
        _looking("left", (2.2, -1.6, 2.0), (-0.6, 0.3, 0.6), (390.0, 269.5, 201.5, -0.08), (540, 404)),
        _looking("right", (-2.2, -1.5, 1.8), (0.5, 0.4, 0.6), (375.0, 269.5, 201.5, -0.05), (540, 404)),
        _looking("back", (0.3, 1.8, 2.1), (-0.1, -0.8, 0.5), (405.0, 269.5, 201.5, -0.02), (540, 404)),
    )
    for camera in fixed:
        cv2.imwrite(str(folder / "fixed" / f"{camera.name}.png"), room.photograph(camera, rng))
    return CameraGroup(fixed)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, CameraGroup]:
    folder = tmp_path_factory.mktemp("scan")
    return folder, _scene(folder)


@pytest.fixture(scope="module")
def found(scene: tuple[Path, CameraGroup], tmp_path_factory: pytest.TempPathFactory) -> ScanCalibration:
    options = ScanOptions(marker_size=_MARKER, marker_on_floor=True, max_features=900)
    return calibrate_scan(scene[0], tmp_path_factory.mktemp("work"), options=options)


@pytest.mark.slow
def test_camera_positions(scene: tuple[Path, CameraGroup], found: ScanCalibration) -> None:
    """In the marker's world and scale, without alignment."""
    truth = scene[1]
    by_name = {c.name: c for c in found.cameras}
    assert set(by_name) == set(truth.names) and found.photos >= 13
    for camera in truth:
        got = by_name[camera.name]
        assert np.linalg.norm(got.center_world - camera.center_world) < 0.03
        turned = (np.trace(got.rotation @ camera.rotation.T) - 1) / 2
        assert np.degrees(np.arccos(np.clip(turned, -1, 1))) < 0.5
        assert got.params[0] == pytest.approx(camera.params[0], rel=0.015)
    assert found.residual_px.max() < 1.0 and found.marker_px < 1.0 and found.matched.min() > 50


@pytest.mark.slow
def test_the_scale_of_the_room(found: ScanCalibration) -> None:
    low, high = np.quantile(found.points_world, [0.02, 0.98], axis=0)
    np.testing.assert_allclose(high[:2], _HALF, atol=0.08)
    np.testing.assert_allclose(low[:2], -_HALF, atol=0.08)
    assert abs(low[2]) < 0.05


def test_missing_inputs_are_early_errors(tmp_path: Path) -> None:
    for part in ("scan", "fixed"):
        (tmp_path / part).mkdir()
    picture = np.zeros((48, 64), np.uint8)
    cv2.imwrite(str(tmp_path / "fixed" / "left.png"), picture)
    with pytest.raises(CalibrationError, match="size of a marker"):
        calibrate_scan(tmp_path, tmp_path)
    with pytest.raises(CalibrationError, match="known distance is between two of the cameras left"):
        calibrate_scan(tmp_path, tmp_path, pair=("left", "right"), options=ScanOptions(distance=2.0))
    with pytest.raises(CalibrationError, match="0 photographs"):
        calibrate_scan(tmp_path, tmp_path, options=ScanOptions(marker_size=0.2))
    for k in range(3):
        cv2.imwrite(str(tmp_path / "scan" / f"{k}.png"), picture)
    with pytest.raises(CalibrationError, match="0 of 3 photographs of the scan fit together"):
        calibrate_scan(tmp_path, tmp_path, options=ScanOptions(marker_size=0.2))
    with pytest.raises(ValueError, match="DICT_4X4_50"):
        ScanOptions(marker_dictionary="DICT_3X3")


@pytest.mark.slow
def test_the_command_scales_by_a_distance(
    scene: tuple[Path, CameraGroup], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Photographs and stills from folders; the world is upright without a marker, and has the right scale."""
    folder, truth = scene
    apart = float(np.linalg.norm(truth["left"].center_world - truth["right"].center_world))
    arguments = ["calibrate", "scan", str(folder / "scan"), "--cameras", str(folder / "fixed"), "--max-features", "900"]
    arguments += ["--between", "left", "right", "--distance", f"{apart:.4f}", "--out", str(tmp_path / "rig.toml")]
    assert run_command([*arguments, "--quiet"]) == 0
    printed = capsys.readouterr().out
    assert "14 of 14 photographs" in printed or "13 of 14 photographs" in printed
    cameras = load_calibration(tmp_path / "rig.toml")
    centers = {c.name: c.center_world for c in cameras}
    assert np.linalg.norm(centers["left"] - centers["back"]) == pytest.approx(
        np.linalg.norm(truth["left"].center_world - truth["back"].center_world), rel=0.01
    )
    for camera in truth:
        assert centers[camera.name][2] == pytest.approx(camera.center_world[2], abs=0.15)
