"""Texts of every calibration format, as the programs write them, of a known rig."""

from pathlib import Path

import cv2
import numpy as np
import pycolmap

from muybridge.geometry.cameras.camera import Camera, colmap_camera
from muybridge.geometry.cameras.group import CameraGroup
from tests.rigs import ring_of_cameras

POINTS_WORLD = np.random.default_rng(1).uniform([-0.8, -0.8, 0.2], [0.8, 0.8, 1.8], (50, 3))


def rig(model: str = "OPENCV", cameras: int = 3) -> CameraGroup:
    """Upright cameras on a circle of 4 m, each with its own lens."""
    distortion = {
        "OPENCV": (-0.05, 0.03, 0.002, -0.003),
        "FULL_OPENCV": (-0.05, 0.03, 0.002, -0.003, 0.01, 0.0, 0.0, 0.0),
        "OPENCV_FISHEYE": (0.03, -0.01, 0.004, -0.001),
    }[model]
    return ring_of_cameras(
        [f"cam{k + 1:02d}" for k in range(cameras)],
        height=[1.5 + 0.1 * k for k in range(cameras)],
        angles=[0.4 + 2.1 * k for k in range(cameras)],
        size=(1280, 720),
        model=model,
        params=[(900.0 + k, 910.0, 652.25, 347.875 + k, *distortion) for k in range(cameras)],
    )


def assert_same_rig(found: CameraGroup, expected: CameraGroup, atol_px: float = 1e-6) -> None:
    assert found.names == expected.names
    assert [(c.width, c.height) for c in found] == [(c.width, c.height) for c in expected]
    np.testing.assert_allclose(found.project(POINTS_WORLD), expected.project(POINTS_WORLD), atol=atol_px)
    np.testing.assert_allclose(found.centers_world, expected.centers_world, atol=1e-9)


# --- how each program writes a rig --------------------------------------------------------------------------


def qualisys_text(group: CameraGroup, left: int = 0, top: int = 0, subpixels: float = 64.0) -> str:
    blocks = []
    for c in group:
        r = np.diag([1.0, -1.0, -1.0]) @ c.rotation
        rij = " ".join(f'r{i + 1}{j + 1}="{float(r[i, j])!r}"' for i in range(3) for j in range(3))
        x, y, z = (c.center_world * 1000).tolist()
        fx, fy, cx, cy, k1, k2, p1, p2 = c.params
        fov = f'left="{left}" top="{top}" right="{left + c.width - 1}" bottom="{top + c.height - 1}"'
        whole = f'left="0" top="0" right="{left + c.width - 1}" bottom="{top + c.height - 1}"'
        blocks.append(
            f'<camera active="1" serial="{c.name}"><fov_video {fov}/><fov_video_max {whole}/>'
            f'<transform x="{x!r}" y="{y!r}" z="{z!r}" {rij}/>'
            f'<intrinsic focalLengthU="{fx * subpixels!r}" focalLengthV="{fy * subpixels!r}" skew="0.0" '
            f'centerPointU="{(cx + left) * subpixels!r}" centerPointV="{(cy + top) * subpixels!r}" '
            f'sensorMinU="0" sensorMaxU="{subpixels * (left + c.width - 1)}" '
            f'sensorMinV="0" sensorMaxV="{subpixels * (top + c.height - 1)}" '
            f'radialDistortion1="{k1!r}" radialDistortion2="{k2!r}" radialDistortion3="0.0" '
            f'tangentalDistortion1="{p1!r}" tangentalDistortion2="{p2!r}"/></camera>'
        )
    body = "\n".join(blocks)
    return f"<?xml version='1.0' encoding='ASCII'?>\n<calibration type=\"regular\">\n<cameras>\n{body}\n</cameras>\n</calibration>\n"  # noqa: E501


def rig_table(c: Camera, scale: float = 1.0, matrix_rotation: bool = False) -> str:
    k = list(c.params[4:])
    fisheye = c.model == "OPENCV_FISHEYE"
    distortions = k if fisheye or len(k) == 4 else [*k[:5]]
    rotation = c.rotation.tolist() if matrix_rotation else cv2.Rodrigues(np.array(c.rotation))[0].ravel().tolist()
    return (
        f"size = [{c.width}.0, {c.height}.0]\nmatrix = {c.camera_matrix.tolist()}\n"
        f"distortions = {distortions}\n"
        f"rotation = {rotation}\ntranslation = {(c.translation * scale).tolist()}\n"
        f"fisheye = {str(fisheye).lower()}\n"
    )


def pose2sim_text(group: CameraGroup) -> str:
    tables = "\n".join(f'[int_{c.name}_img]\nname = "{c.name}"\n{rig_table(c)}' for c in group)
    return tables + "\n[metadata]\nadjusted = false\nerror = 0.0\n"


def caliscope_text(group: CameraGroup, matrix_rotation: bool = False) -> str:
    return "\n".join(
        f"[cameras.{k}]\ncam_id = {k}\nrotation_count = 0\nignore = false\n"
        + rig_table(c, matrix_rotation=matrix_rotation)
        for k, c in enumerate(group)
    )


def opencv_text(group: CameraGroup, layout: str = "maps") -> str:
    kind = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML
    storage = cv2.FileStorage("calibration.yml", kind)
    if layout == "sequence":
        storage.startWriteStruct("cameras", cv2.FILE_NODE_SEQ)
    for c in group:
        if layout != "single":
            storage.startWriteStruct("" if layout == "sequence" else c.name, cv2.FILE_NODE_MAP)
        if layout == "sequence":
            storage.write("name", c.name)
        storage.write("image_width", c.width)
        storage.write("image_height", c.height)
        storage.write("camera_matrix", c.camera_matrix)
        storage.write("distortion_coefficients", np.array([c.params[4:]]))
        storage.write("rvec", cv2.Rodrigues(np.array(c.rotation))[0])
        storage.write("tvec", c.translation.reshape(3, 1))
        if c.model == "OPENCV_FISHEYE":
            storage.write("distortion_model", "fisheye")
        if layout != "single":
            storage.endWriteStruct()
    if layout == "sequence":
        storage.endWriteStruct()
    return str(storage.releaseAndGetString())


def colmap_model(group: CameraGroup, folder: Path, text: bool, names: list[str] | None = None) -> Path:
    folder.mkdir(exist_ok=True)
    model = pycolmap.Reconstruction()
    for k, c in enumerate(group, start=1):
        lens = colmap_camera(c)
        lens.camera_id = k
        model.add_camera_with_trivial_rig(lens)
        image = pycolmap.Image(
            name=names[k - 1] if names else f"{c.name}.png",
            points2D=[pycolmap.Point2D([1.0, 2.0 + i]) for i in range(k - 1)],
            camera_id=k,
            image_id=k,
        )
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(np.array(c.rotation)), np.array(c.translation))
        model.add_image_with_trivial_frame(image, pose)
    (model.write_text if text else model.write_binary)(folder)
    return folder


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path
