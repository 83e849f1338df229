"""Calibration of fixed cameras from a scan: structure from motion on photographs of the room, then registration.

COLMAP's incremental mapping (Schonberger and Frahm, "Structure-from-motion revisited", 2016) reconstructs the scan; a
still image of each fixed camera is then registered in it, followed by one bundle adjustment of everything. Scale and
axes of the reconstruction are arbitrary: the scale comes from a marker of known size or a known distance between two
cameras; the vertical from the marker if it lies on the floor, else from the orientation of the photographs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.errors import CalibrationError
from muybridge.geometry.cameras import _pycolmap as pycolmap
from muybridge.geometry.cameras.camera import Camera, camera_from_colmap, colmap_camera
from muybridge.geometry.cameras.group import CameraGroup

SCAN_FOLDER, FIXED_FOLDER = "scan", "fixed"
_FEWEST_PHOTOS = 3
_FEWEST_MARKER_VIEWS = 2


@dataclass(frozen=True)
class ScanOptions:
    """Options of the calibration from a scan.

    Attributes:
        marker_size: side of the square ArUco marker's black border, metres; 0: no marker.
        marker_dictionary: OpenCV's name of its dictionary.
        marker_id: its number; -1 for the one that is visible most often.
        marker_on_floor: whether the marker lies on the floor, face up; it is the origin then, and its normal is up.
        distance: known distance between two fixed cameras, metres, instead of a marker; 0: none.
        max_image_side: images are reduced to this size before features are extracted, px.
        max_features: maximum number of features per image.
        seed: seed of random numbers.
    """

    marker_size: float = 0.0
    marker_dictionary: str = "DICT_4X4_50"
    marker_id: int = -1
    marker_on_floor: bool = False
    distance: float = 0.0
    max_image_side: int = 1600
    max_features: int = 4096
    seed: int = 0

    def __post_init__(self) -> None:
        if min(self.marker_size, self.distance) < 0:
            raise ValueError("marker_size and distance are in metres and positive")
        if not hasattr(cv2.aruco, self.marker_dictionary):
            raise ValueError(f"OpenCV has no marker dictionary {self.marker_dictionary}; one is DICT_4X4_50")


@dataclass(frozen=True)
class ScanCalibration:
    """Cameras from a scan.

    Attributes:
        cameras: the fixed cameras, metres, Z up.
        photos: number of registered photographs of the scan.
        points_world: (N, 3) reconstructed points of the room, metres.
        residual_px: (C,) median reprojection error of each fixed camera.
        matched: (C,) number of points of the room that each fixed camera sees.
        marker_px: median reprojection error of the marker's corners; NaN without a marker.
        notes: assumptions, in plain sentences.
    """

    cameras: CameraGroup
    photos: int
    points_world: FloatArray
    residual_px: FloatArray
    matched: IntArray
    marker_px: float
    notes: tuple[str, ...]


def calibrate_scan(
    images: Path,
    work: Path,
    lenses: CameraGroup | None = None,
    pair: Sequence[str] = (),
    options: ScanOptions = ScanOptions(),
) -> ScanCalibration:
    """Calibrate fixed cameras from a scan.

    Args:
        images: folder with `scan/` (photographs of one camera) and `fixed/` (one still image per camera, with its
            name).
        work: folder for COLMAP's database; an earlier one is deleted.
        lenses: fixed cameras with known lenses, by name; these are kept. Others are estimated.
        pair: the two fixed cameras between which `options.distance` is measured.
        options: see `ScanOptions`.

    Raises:
        CalibrationError: a scan whose photographs do not fit together, a camera that does not see the scanned area (the
            message names it), a marker that is not found, or no way to determine the scale.
    """
    fixed = {p.stem: f"{FIXED_FOLDER}/{p.name}" for p in sorted((images / FIXED_FOLDER).iterdir())}
    photos = [f"{SCAN_FOLDER}/{p.name}" for p in sorted((images / SCAN_FOLDER).iterdir())]
    _check_size(fixed, pair, options)
    if len(photos) < _FEWEST_PHOTOS:
        raise CalibrationError(f"the scan has {len(photos)} photographs; {_FEWEST_PHOTOS} are needed, 30 are good")
    rec = _reconstruct(images, work, photos, fixed, lenses, options)
    rig = {name: _camera(rec, name, file) for name, file in fixed.items()}
    placed, marker_px, notes = _world_of(rec, images, rig, pair, options)
    errors, matched = zip(*(_fit_of(rec, file) for file in fixed.values()), strict=True)
    scale, rotation, origin = placed
    points = np.array([p.xyz for p in rec.points3D.values()]).reshape(-1, 3)
    registered = {rec.images[i].name for i in rec.reg_image_ids()}
    return ScanCalibration(
        cameras=CameraGroup(tuple(_transform_camera(c, scale, rotation, origin) for c in rig.values())),
        photos=len(registered & set(photos)),
        points_world=scale * (points - origin) @ rotation.T,
        residual_px=np.array(errors),
        matched=np.array(matched),
        marker_px=marker_px,
        notes=tuple(notes),
    )


def _check_size(fixed: dict[str, str], pair: Sequence[str], options: ScanOptions) -> None:
    if not fixed:
        raise CalibrationError("there is no still of any fixed camera")
    if options.distance and (len(pair) != 2 or not set(pair) <= set(fixed)):
        raise CalibrationError(f"the known distance is between two of the cameras {', '.join(fixed)}: name both")
    if not options.marker_size and not options.distance:
        raise CalibrationError(
            "nothing says how large the room is: give the size of a marker that the scan shows, or the distance "
            "between two cameras"
        )


def _reconstruct(
    images: Path,
    work: Path,
    photos: list[str],
    fixed: dict[str, str],
    lenses: CameraGroup | None,
    options: ScanOptions,
) -> Any:
    """The scan with the fixed cameras, as a `pycolmap.Reconstruction`."""
    pycolmap.logging.minloglevel = 3
    database = work / "database.db"
    database.unlink(missing_ok=True)
    pycolmap.set_random_seed(options.seed)
    extraction = pycolmap.FeatureExtractionOptions(use_gpu=False, max_image_size=options.max_image_side)
    extraction.sift.max_num_features = options.max_features
    cpu, mode = pycolmap.Device.cpu, pycolmap.CameraMode
    reader = pycolmap.ImageReaderOptions(camera_model="SIMPLE_RADIAL")
    pycolmap.extract_features(database, images, photos, mode.SINGLE, reader, extraction, cpu)
    for name, file in fixed.items():
        pycolmap.extract_features(database, images, [file], mode.PER_IMAGE, _reader(lenses, name), extraction, cpu)
    pycolmap.match_exhaustive(database, pycolmap.FeatureMatchingOptions(use_gpu=False), device=cpu)
    how = pycolmap.IncrementalPipelineOptions(multiple_models=False, random_seed=options.seed, min_model_size=3)
    how.image_names = photos
    found = pycolmap.incremental_mapping(database, images, _made(work / "scan_model"), how)
    rec = max(found.values(), key=lambda r: r.num_reg_images(), default=None)
    registered = 0 if rec is None else rec.num_reg_images()
    if rec is None or registered < max(_FEWEST_PHOTOS, 0.4 * len(photos)):
        raise CalibrationError(
            f"only {registered} of {len(photos)} photographs of the scan fit together: walk slowly around the room "
            "with much overlap between photographs, do not only turn on the spot, and have texture in view"
        )
    how.image_names = [*photos, *fixed.values()]
    how.constant_cameras = _held(database, fixed, lenses)
    how.ba_global_frames_ratio = 1.0001  # adjust after every camera
    start = _made(work / "scan_only")
    rec.write(start)
    found = pycolmap.incremental_mapping(database, images, _made(work / "model"), how, input_path=start)
    rec = max(found.values(), key=lambda r: r.num_reg_images(), default=rec)
    names = {rec.images[i].name for i in rec.reg_image_ids()}
    lost = [name for name, file in fixed.items() if file not in names]
    if lost:
        raise CalibrationError(
            f"{', '.join(lost)} could not be found in the scan: take photographs from beside the camera, as it looks, "
            "and from there on along the walk, in the same light"
        )
    return rec


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _reader(lenses: CameraGroup | None, name: str) -> Any:
    if lenses is None or name not in lenses:
        return pycolmap.ImageReaderOptions(camera_model="SIMPLE_RADIAL")
    lens = colmap_camera(lenses[name])
    params = ",".join(repr(float(p)) for p in lens.params)
    return pycolmap.ImageReaderOptions(camera_model=lenses[name].model, camera_params=params)


def _held(database: Path, fixed: dict[str, str], lenses: CameraGroup | None) -> set[int]:
    """COLMAP's numbers of the cameras with known lenses."""
    if lenses is None:
        return set()
    with pycolmap.Database.open(database) as opened:
        camera_of = {image.name: image.camera_id for image in opened.read_all_images()}
    return {camera_of[file] for name, file in fixed.items() if name in lenses}


def _image(rec: Any, file: str) -> Any:
    return next(rec.images[i] for i in rec.reg_image_ids() if rec.images[i].name == file)


def _camera(rec: Any, name: str, file: str) -> Camera:
    image = _image(rec, file)
    return camera_from_colmap(name, rec.cameras[image.camera_id], image.cam_from_world().matrix())


def _fit_of(rec: Any, file: str) -> tuple[float, int]:
    """Median reprojection error of an image, and the number of points that it sees."""
    image = _image(rec, file)
    seen = [p for p in image.points2D if p.has_point3D()]
    if not seen:
        return float("nan"), 0
    world = np.array([rec.points3D[p.point3D_id].xyz for p in seen])
    camera = _camera(rec, file, file)
    off = np.linalg.norm(camera.project(world) + 0.5 - np.array([p.xy for p in seen]), axis=1)
    return float(np.nanmedian(off)), len(seen)


def _transform_camera(camera: Camera, scale: float, rotation: FloatArray, origin: FloatArray) -> Camera:
    """The camera in the world `scale rotation (x - origin)`."""
    turn = camera.rotation @ rotation.T
    center = scale * rotation @ (camera.center_world - origin)
    return replace(camera, cam_from_world=np.column_stack([turn, -turn @ center]))


def _world_of(
    rec: Any, images: Path, rig: dict[str, Camera], pair: Sequence[str], options: ScanOptions
) -> tuple[tuple[float, FloatArray, FloatArray], float, list[str]]:
    """Scale, rotation and origin of the world, the marker's reprojection error, and what was assumed."""
    marker, marker_px, notes = None, float("nan"), []
    if options.marker_size:
        marker, marker_px = _marker(rec, images, options)
        scale = options.marker_size / float(np.mean(np.linalg.norm(marker - np.roll(marker, 1, axis=0), axis=1)))
    if options.distance:
        apart = float(np.linalg.norm(rig[pair[0]].center_world - rig[pair[1]].center_world))
        by_distance = options.distance / apart
        if marker is not None and abs(by_distance / scale - 1) > 0.02:
            off = abs(by_distance / scale - 1)
            notes.append(f"the marker and the distance disagree by {off:.1%}: the distance counts")
        scale = by_distance
    if marker is not None and options.marker_on_floor:
        across, along = marker[1] - marker[0], marker[0] - marker[3]  # corners run clockwise from the top left
        x = across / np.linalg.norm(across)
        up = np.cross(x, along)
        up /= np.linalg.norm(up)
        return (scale, np.stack([x, np.cross(up, x), up]), marker.mean(axis=0)), marker_px, notes
    up = _up(rec)
    x = np.cross([0.0, 1.0, 0.0] if abs(up[1]) < 0.9 else [1.0, 0.0, 0.0], up)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(up, x), up])
    points = np.array([p.xyz for p in rec.points3D.values()])
    floor = float(np.quantile(points @ up, 0.01))
    middle = np.mean([c.center_world for c in rig.values()], axis=0)
    origin = middle - (middle @ up - floor) * up
    notes.append(
        "up is estimated from how the photographs were held, and the floor from the lowest points; a marker that lies "
        "on the floor (option marker_on_floor) determines both"
    )
    return (scale, rotation, origin), marker_px, notes


def _up(rec: Any) -> FloatArray:
    """Vertical direction, assuming that most photographs are held level: perpendicular to their horizontal axes."""
    turns = np.stack([rec.images[i].cam_from_world().matrix()[:, :3] for i in rec.reg_image_ids()])
    across = turns[:, 0]
    up = np.linalg.eigh(across.T @ across)[1][:, 0]
    return up if (turns[:, 1] @ up).mean() < 0 else -up


def _marker(rec: Any, images: Path, options: ScanOptions) -> tuple[FloatArray, float]:
    """(4, 3) corners of the marker in the reconstruction, and their median reprojection error, px."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, options.marker_dictionary))
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(dictionary, parameters)
    views: dict[int, list[tuple[Camera, FloatArray]]] = {}
    for i in rec.reg_image_ids():
        image = rec.images[i]
        picture = cv2.imread(str(images / image.name), cv2.IMREAD_GRAYSCALE)
        if picture is None:
            continue
        quads, ids, _ = detector.detectMarkers(picture)
        for number, found in zip(np.ravel(ids) if ids is not None else [], quads, strict=True):
            if options.marker_id in (-1, int(number)):
                camera = _camera(rec, image.name, image.name)
                views.setdefault(int(number), []).append((camera, np.asarray(found, float).reshape(4, 2)))
    seen = max(views.values(), key=len, default=[])
    if len(seen) < _FEWEST_MARKER_VIEWS:
        which = "no marker" if options.marker_id < 0 else f"marker {options.marker_id}"
        raise CalibrationError(
            f"{which} of {options.marker_dictionary} is visible in two registered photographs; photograph it from "
            "nearby and from several sides",
            remedy="marker_dictionary",
        )
    corners = np.stack([_meeting_point([c for c, _ in seen], np.stack([px[k] for _, px in seen])) for k in range(4)])
    off = [np.linalg.norm(c.project(corners) - px, axis=1) for c, px in seen]
    return corners, float(np.median(off))


def _meeting_point(cameras: Sequence[Camera], px: FloatArray) -> FloatArray:
    """(3,) point nearest to the rays of cameras, robustly weighted."""
    rays = np.stack([c.rays(p) for c, p in zip(cameras, px, strict=True)])
    centers = np.stack([c.center_world for c in cameras])
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    weight = np.ones(len(rays))
    point = np.zeros(3)
    for _ in range(10):
        system = (weight[:, None, None] * across).sum(axis=0)
        point = np.linalg.solve(system, np.einsum("n,nij,nj->i", weight, across, centers))
        depth = np.linalg.norm(point - centers, axis=1)
        missed = np.linalg.norm(np.einsum("nij,nj->ni", across, point - centers), axis=1) / depth
        typical = max(float(np.median(missed)), 1e-9)
        weight = 1 / depth**2 / (1 + (missed / (2 * typical)) ** 2)
    return point
