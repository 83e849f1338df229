"""`muybridge calibrate world`: origin, floor, axes and size of a calibration."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from muybridge.arrays import FloatArray
from muybridge.errors import CalibrationError
from muybridge.geometry.association.select import select_person, take_person
from muybridge.geometry.calibration import load_calibration, save_calibration
from muybridge.geometry.calibration.board.board import Board
from muybridge.geometry.calibration.board.intrinsics import View, board_pose, usable
from muybridge.geometry.calibration.board.pose_graph import symmetries
from muybridge.geometry.calibration.formats.common import far_apart_note
from muybridge.geometry.calibration.people.world import world_from_people
from muybridge.geometry.calibration.world import check_shape, marked, moved, on_board, on_points
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.triangulation.multiview import triangulate
from muybridge.infer.commands.calibrate.board import BoardChoice, chosen_board
from muybridge.infer.commands.calibrate.board_images import at_moment, find_pictures, look_for_board
from muybridge.infer.commands.calibrate.outputs import check_replaceable
from muybridge.infer.commands.calibrate.points import read_points
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.pipelines.landmarks import session_keypoints
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import SessionOptions, open_session

COMMON_OPTIONS = {
    "world": (
        "out", "overwrite", "points", "floor_board", "people", "moment", "height", "keep_scale", "turn_deg", "origin",
    )
}  # fmt: skip
_STILL_PX = 3.0


def world(
    calibration: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="CALIBRATION")],
    /,
    out: Path,
    points: Path | None = None,
    floor_board: Path | None = None,
    people: Path | None = None,
    pattern: BoardChoice = BoardChoice(),  # noqa: B008 - frozen
    moment: int | None = None,
    height: float | None = None,
    keep_scale: bool = False,
    scale_by: float = 1.0,
    turn_deg: float = 0.0,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    session: SessionOptions = SessionOptions(),  # noqa: B008
    detect: DetectOptions = DetectOptions(),  # noqa: B008
    overwrite: bool = False,
) -> int:
    """Set a calibration's origin, floor, axes and size: from marked points, a board on the floor, or people.

    Args:
        calibration: file of any known format.
        out: calibration file to write (TOML).
        points: CSV with the columns camera, x, y, z (metres, in the wanted world), u, v (px): at least three
            points, each marked in two cameras or more.
        floor_board: folder with a film, or a folder of images, for each camera, that shows a board lying on the
            floor: its first corner becomes the origin, its columns run along +X, Z is up.
        people: session folder in which people walk about: the floor is where their feet are.
        pattern: what board it is.
        moment: picture (number of frame or image) in which the board lies there, if it does not in all of them.
        height: of the (first) person, metres; without it the calibration's size is kept.
        keep_scale: only turn and move, also where points or the board tell another size.
        scale_by: then also make everything larger by this factor.
        turn_deg: then also turn the world about Z, counterclockwise seen from above.
        origin: then also move the origin to this place, metres, in the world so far.
        session: how the session folder is read.
        detect: 2D landmarks.
        overwrite: replace files there that muybridge did not write.
    """
    check_replaceable([out], overwrite)
    cameras = load_calibration(calibration)
    by_hand = scale_by != 1 or turn_deg != 0 or any(origin)
    _one_source((("--points", points), ("--floor-board", floor_board), ("--people", people)), by_hand)
    if not (np.isfinite([scale_by, turn_deg, *origin]).all() and scale_by > 0):
        raise CalibrationError(f"--scale-by must be positive, not {scale_by:g}; all numbers finite")
    with Progress() as progress:
        if points is not None:
            changed, said = by_points(cameras, points, keep_scale)
        elif floor_board is not None:
            changed, said = by_board(cameras, chosen_board(pattern), floor_board, moment, keep_scale, progress)
        elif people is not None:
            before, after, said = by_people(people, replace(session, calibration=calibration), detect, height, progress)
            changed = _likewise(cameras, before, after)
        else:
            changed, said = cameras, []
    if by_hand:
        changed = _by_hand(changed, scale_by, turn_deg, origin)
    save_calibration(changed, out)
    for line in [*said, *_places(changed), f"written: {out}"]:
        print(line)
    return 0


def _one_source(sources: Sequence[tuple[str, Path | None]], by_hand: bool) -> None:
    given = [name for name, value in sources if value]
    if len(given) > 1 or not (given or by_hand):
        raise CalibrationError(
            f"give one of --points, --floor-board, --people ({' and '.join(given) or 'none'} given), or change the "
            "world by hand with --scale-by, --turn-deg, --origin"
        )


def _by_hand(cameras: CameraGroup, scale_by: float, turn_deg: float, origin: tuple[float, float, float]) -> CameraGroup:
    angle = np.radians(-turn_deg)  # the world's axes turn one way, what is in it the other
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    return moved(cameras, np.column_stack([turn, -turn @ (scale_by * np.array(origin))]), scale_by)


def by_points(cameras: CameraGroup, path: Path, keep_scale: bool) -> tuple[CameraGroup, list[str]]:
    """Cameras in the world of marked points, and what is worth saying."""
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
        raise CalibrationError(f"{path}: {error}") from None
    off = [f"({x:g}, {y:g}, {z:g}) {1e3 * e:.0f} mm" for (x, y, z), e in zip(places, placed.errors, strict=True)]
    said = [f"points: {', '.join(off)} off", _size_said(placed.scale, keep_scale)]
    changed = moved(cameras, placed.new_from_old, placed.scale)
    return changed, [*said, *far_apart_note(changed, "the points' coordinates")]


def by_board(
    cameras: CameraGroup, board: Board, folder: Path, moment: int | None, keep_scale: bool, progress: Progress
) -> tuple[CameraGroup, list[str]]:
    """Cameras in the world of a board that lies on the floor, and what is worth saying."""
    pictures = [p for p in find_pictures(folder, moment=moment) if p.name in cameras]
    if not pictures:
        raise CalibrationError(f"{folder}: no film or folder is named as a camera ({', '.join(cameras.names)})")
    if moment is not None:
        pictures = at_moment(pictures, moment, "--moment")
    views, sizes = look_for_board(pictures, board, progress)
    for name, size in sizes.items():
        if size != (cameras[name].width, cameras[name].height):
            raise CalibrationError(
                f"{folder}: camera {name}: {size[0]} x {size[1]} px here, {cameras[name].width} x "
                f"{cameras[name].height} in the calibration"
            )
    pixels = _lying(cameras, board, views)
    seen = np.isfinite(pixels[..., 0])
    best = int(np.argmax(seen.sum(axis=1)))
    if seen[best].sum() < 6:
        raise CalibrationError(f"{folder}: the board ({board.describe()}) is seen by no camera; check its description")
    scale, said = 1.0, "size: kept, since only one camera sees the board"
    if (seen.sum(axis=0) >= 2).sum() >= 6:
        placed = on_points(cameras, pixels, board.corners, keep_scale)
        from_new = placed.new_from_old[:, :3].T
        pose = np.column_stack([from_new, -from_new @ placed.new_from_old[:, 3]])
        scale, said = placed.scale, _size_said(placed.scale, keep_scale)
    else:
        ids = np.nonzero(seen[best])[0]
        cam_from_board = board_pose(cameras[best], board, (ids, pixels[best, ids]))
        back = cameras[best].rotation.T
        pose = np.column_stack(
            [back @ cam_from_board[:3, :3], back @ (cam_from_board[:3, 3] - cameras[best].translation)]
        )
    scaled = moved(cameras, np.eye(4)[:3], scale)
    looking = scaled.select([n for c, n in enumerate(cameras.names) if seen[c].any()])
    return moved(scaled, on_board(looking, pose)), [said]


def _lying(cameras: CameraGroup, board: Board, views: Mapping[str, Mapping[int, View]]) -> FloatArray:
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
                f"camera {name}: the board moves by {spread:.0f} px from picture to picture; it must lie still on the "
                "floor: name the picture in which it does with --moment"
            )
        if usable(board, [(np.nonzero(counted)[0], middle)]):
            out[cameras.names.index(name), counted] = middle
    if board.kind == "checkerboard" and np.isfinite(out[..., 0]).any(axis=1).sum() > 1:
        out = _same_way_round(cameras, board, out)
    return out


def _same_way_round(cameras: CameraGroup, board: Board, pixels: FloatArray) -> FloatArray:
    """The same, the corners numbered the same way round by all cameras: so that their rays meet."""
    seen = [c for c in range(len(cameras)) if np.isfinite(pixels[c, :, 0]).any()]
    out = pixels.copy()
    for c in seen[1:]:
        pair = cameras.select([cameras.names[seen[0]], cameras.names[c]])
        tried = []
        for _, number in symmetries(board):
            turned = np.full_like(pixels[c], np.nan)
            turned[number] = pixels[c]
            both = np.stack([pixels[seen[0]], turned])
            error = np.linalg.norm(pair.project(marked(pair, both)) - both, axis=-1)
            tried.append((float(np.nanmedian(error)), turned))
        out[c] = min(tried, key=lambda t: t[0])[1]
    return out


def by_people(
    session: Path, read: SessionOptions, detect: DetectOptions, height: float | None, progress: Progress
) -> tuple[CameraGroup, CameraGroup, list[str]]:
    """The session's cameras as calibrated, in the world of people who walk on its floor, and what is worth saying."""
    opened, keypoints = session_keypoints(open_session(session, read), None, detect, progress)
    px, variance, _ = take_person(keypoints, select_person(opened.cameras, keypoints, fps=opened.fps))
    found = triangulate(opened.cameras, px, variance)
    changed, said = people_world(opened.cameras, found.points_world, keypoints.landmarks.names, height)
    return opened.cameras, changed, said


def people_world(
    cameras: CameraGroup, points: FloatArray, names: Sequence[str], height: float | None
) -> tuple[CameraGroup, list[str]]:
    """Cameras in the world of people; the size is kept where no height is given.

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
        return changed, [*notes, _size_said(scale, False)]
    kept = [n for n in notes if not n.startswith("scale")]
    return moved(changed, np.eye(4)[:3], 1 / scale), [*kept, "size: kept"]


def _likewise(cameras: CameraGroup, before: CameraGroup, after: CameraGroup) -> CameraGroup:
    """Cameras moved as some others were; those may be fewer, or turned to suit their videos."""
    a, b = before.centers_world, after.centers_world
    far = np.linalg.norm(a - a[0], axis=1)
    k = int(np.argmax(far))
    scale = float(np.linalg.norm(b[k] - b[0]) / far[k]) if far[k] > 0 else 1.0
    rotation = after[0].rotation.T @ before[0].rotation
    return moved(cameras, np.column_stack([rotation, b[0] - scale * rotation @ a[0]]), scale)


def _size_said(scale: float, kept: bool) -> str:
    return "size: kept" if kept else f"size: everything is {scale:.4f} times as large as before"


def _places(cameras: CameraGroup) -> list[str]:
    centers = cameras.centers_world
    return [f"{n}: at ({x:.2f}, {y:.2f}, {z:.2f}) m" for n, (x, y, z) in zip(cameras.names, centers, strict=True)]
