"""Origin, floor, axes and scale of a calibration's world."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import CalibrationError
from muybridge.geometry.association.select import select_person, take_person
from muybridge.geometry.calibration.board.board import Board
from muybridge.geometry.calibration.board.intrinsics import View, board_pose, usable
from muybridge.geometry.calibration.board.pose_graph import symmetries
from muybridge.geometry.calibration.formats.common import far_apart_note
from muybridge.geometry.calibration.people.world import world_from_people
from muybridge.geometry.calibration.world import check_shape, on_board, on_points, transform_cameras, triangulate_marked
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.triangulation.multiview import triangulate
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.pipelines.calibration.board_images import at_moment, find_board, find_images
from muybridge.infer.pipelines.calibration.known_points import read_points
from muybridge.infer.pipelines.landmarks import session_keypoints
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import SessionOptions, open_session

# Pixels; a board that moves by more between images does not lie still.
_STILL_PX = 3.0


def change_world(
    cameras: CameraGroup, scale_by: float, turn_deg: float, origin: tuple[float, float, float]
) -> CameraGroup:
    """Scale the world, turn it about Z and move its origin.

    Args:
        cameras: as calibrated.
        scale_by: factor of all lengths.
        turn_deg: angle of the turn, counterclockwise seen from above.
        origin: (3,) metres, the new origin in the old world.
    """
    angle = np.radians(-turn_deg)  # the world's axes turn one way, what is in it the other
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return transform_cameras(cameras, np.column_stack([turn, -turn @ (scale_by * np.array(origin))]), scale_by)


def world_from_points(cameras: CameraGroup, path: Path, keep_scale: bool) -> tuple[CameraGroup, list[str]]:
    """Move cameras to the world of marked points.

    Args:
        cameras: as calibrated.
        path: CSV file of points in the wanted world, see `read_points`.
        keep_scale: turn and move only.

    Returns:
        The cameras, and a summary in sentences.

    Raises:
        CalibrationError: the points do not fit the cameras.
    """
    known = read_points(path)
    unknown = [n for n in known if n not in cameras]
    if unknown:
        raise CalibrationError(
            f"{path}: no camera {', '.join(unknown)} in the calibration; it has {', '.join(cameras.names)}"
        )
    places = np.unique(np.concatenate([k.points for k in known.values()]), axis=0)
    pixels = np.full((len(cameras), len(places), 2), np.nan)
    for name, mine in known.items():
        for x, px in zip(mine.points, mine.pixels, strict=True):
            pixels[cameras.names.index(name), int(np.argmin(np.abs(places - x).sum(axis=1)))] = px
    placed = on_points(cameras, pixels, places, keep_scale)
    try:
        check_shape(placed.points, places)
    except CalibrationError as error:
        raise error.about(str(path)) from None
    off = [f"({x:g}, {y:g}, {z:g}) {1e3 * e:.0f} mm" for (x, y, z), e in zip(places, placed.errors, strict=True)]
    lines = [f"points: {', '.join(off)} off", _scale_text(placed.scale, keep_scale)]
    changed = transform_cameras(cameras, placed.new_from_old, placed.scale)
    return changed, [*lines, *far_apart_note(changed, "the points' coordinates")]


def world_from_board(
    cameras: CameraGroup, board: Board, folder: Path, moment: int | None, keep_scale: bool, progress: Progress
) -> tuple[CameraGroup, list[str]]:
    """Move cameras to the world of a board that lies on the floor.

    Args:
        cameras: as calibrated.
        board: which board.
        folder: videos or folders of images, one per camera, that show it.
        moment: number of the image in which it lies there; None where it never moves.
        keep_scale: turn and move only.
        progress: receives progress messages.

    Returns:
        The cameras, and a summary in sentences.

    Raises:
        CalibrationError: the board is not seen, moves, or was recorded at another image size.
    """
    images = [p for p in find_images(folder, moment=moment) if p.name in cameras]
    if not images:
        raise CalibrationError(f"{folder}: no video or folder is named as a camera ({', '.join(cameras.names)})")
    if moment is not None:
        images = at_moment(images, moment, "moment")
    views, sizes = find_board(images, board, progress)
    for name, size in sizes.items():
        if size != (cameras[name].width, cameras[name].height):
            raise CalibrationError(
                f"{folder}: camera {name}: {size[0]} x {size[1]} px here, {cameras[name].width} x "
                f"{cameras[name].height} in the calibration"
            )
    pixels = _static_corners(cameras, board, views)
    seen = np.isfinite(pixels[..., 0])
    best = int(np.argmax(seen.sum(axis=1)))
    if seen[best].sum() < 6:
        raise CalibrationError(f"{folder}: the board ({board.describe()}) is seen by no camera; check its description")
    scale, line = 1.0, "size: kept, since only one camera sees the board"
    if (seen.sum(axis=0) >= 2).sum() >= 6:
        placed = on_points(cameras, pixels, board.corners, keep_scale)
        from_new = placed.new_from_old[:, :3].T
        pose = np.column_stack([from_new, -from_new @ placed.new_from_old[:, 3]])
        scale, line = placed.scale, _scale_text(placed.scale, keep_scale)
    else:
        ids = np.nonzero(seen[best])[0]
        cam_from_board = board_pose(cameras[best], board, (ids, pixels[best, ids]))
        back = cameras[best].rotation.T
        pose = np.column_stack(
            [back @ cam_from_board[:3, :3], back @ (cam_from_board[:3, 3] - cameras[best].translation)]
        )
    scaled = transform_cameras(cameras, np.eye(4)[:3], scale)
    looking = scaled.select([n for c, n in enumerate(cameras.names) if seen[c].any()])
    return transform_cameras(scaled, on_board(looking, pose)), [line]


def _static_corners(cameras: CameraGroup, board: Board, views: Mapping[str, Mapping[int, View]]) -> FloatArray:
    """(C, K, 2) px of the corners of a board that does not move, NaN where a camera does not see them."""
    out = np.full((len(cameras), len(board.corners), 2), np.nan)
    for name, mine in views.items():
        good = usable(board, list(mine.values()))
        if not good:
            continue
        every = np.full((len(good), len(board.corners), 2), np.nan)
        for k, (ids, px) in enumerate(good):
            every[k, ids] = px
        counted = np.isfinite(every[..., 0]).sum(axis=0) >= (len(good) + 1) // 2
        middle = np.nanmedian(every[:, counted], axis=0)
        spread = float(np.nanmedian(np.linalg.norm(every[:, counted] - middle, axis=-1)))
        if spread > _STILL_PX:
            raise CalibrationError(
                f"camera {name}: the board moves by {spread:.0f} px between images; it must lie still on the floor",
                remedy="still_moment",
            )
        if usable(board, [(np.nonzero(counted)[0], middle)]):
            out[cameras.names.index(name), counted] = middle
    if board.kind == "checkerboard" and np.isfinite(out[..., 0]).any(axis=1).sum() > 1:
        out = _with_same_numbering(cameras, board, out)
    return out


def _with_same_numbering(cameras: CameraGroup, board: Board, pixels: FloatArray) -> FloatArray:
    """The same, with the corners numbered from the same end by all cameras, so that their rays meet."""
    seen = [c for c in range(len(cameras)) if np.isfinite(pixels[c, :, 0]).any()]
    out = pixels.copy()
    for c in seen[1:]:
        pair = cameras.select([cameras.names[seen[0]], cameras.names[c]])
        tried = []
        for _, number in symmetries(board):
            turned = np.full_like(pixels[c], np.nan)
            turned[number] = pixels[c]
            both = np.stack([pixels[seen[0]], turned])
            error = np.linalg.norm(pair.project(triangulate_marked(pair, both)) - both, axis=-1)
            tried.append((float(np.nanmedian(error)), turned))
        out[c] = min(tried, key=lambda t: t[0])[1]
    return out


def world_from_session(
    cameras: CameraGroup,
    path: Path,
    height: float | None,
    session: SessionOptions,
    detect: DetectOptions,
    progress: Progress,
) -> tuple[CameraGroup, list[str]]:
    """Move cameras to the world of people who walk on the floor of a session.

    Args:
        cameras: as calibrated; the session may have fewer.
        path: the session's folder.
        height: of the person, metres; None to keep the scale.
        session: how the session folder is read.
        detect: how 2D landmarks are detected.
        progress: receives progress messages.

    Returns:
        The cameras, and a summary in sentences.

    Raises:
        MuybridgeError: the session cannot be used, or its people do not suffice.
    """
    opened, keypoints = session_keypoints(open_session(path, session), None, detect, progress)
    px, variance, _ = take_person(keypoints, select_person(opened.cameras, keypoints, fps=opened.fps))
    found = triangulate(opened.cameras, px, variance)
    changed, lines = world_from_landmarks(opened.cameras, found.points_world, keypoints.landmarks.names, height)
    return _move_likewise(cameras, opened.cameras, changed), lines


def world_from_landmarks(
    cameras: CameraGroup, points: FloatArray, names: Sequence[str], height: float | None
) -> tuple[CameraGroup, list[str]]:
    """Move cameras to the world of a person; the scale is kept where no height is given.

    Args:
        cameras: as calibrated.
        points: (T, J, 3) landmarks, metres.
        names: (J,).
        height: of the person, metres.
    """
    changed, _, notes = world_from_people(cameras, points, names, height)
    ways = [np.linalg.norm(np.diff(c.centers_world, axis=0), axis=1).sum() for c in (cameras, changed)]
    scale = float(ways[1] / ways[0])
    if height is not None:
        return changed, [*notes, _scale_text(scale, False)]
    kept = [n for n in notes if not n.startswith("scale")]
    return transform_cameras(changed, np.eye(4)[:3], 1 / scale), [*kept, "size: kept"]


def _move_likewise(cameras: CameraGroup, before: CameraGroup, after: CameraGroup) -> CameraGroup:
    """Move cameras as others were moved; those may be fewer, or turned to suit their videos."""
    a, b = before.centers_world, after.centers_world
    far = np.linalg.norm(a - a[0], axis=1)
    k = int(np.argmax(far))
    scale = float(np.linalg.norm(b[k] - b[0]) / far[k]) if far[k] > 0 else 1.0
    rotation = after[0].rotation.T @ before[0].rotation
    return transform_cameras(cameras, np.column_stack([rotation, b[0] - scale * rotation @ a[0]]), scale)


def _scale_text(scale: float, kept: bool) -> str:
    return "size: kept" if kept else f"size: everything is {scale:.4f} times as large as before"
