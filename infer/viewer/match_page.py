"""The page in which a figure is steered by motion matching: a database in compact form, and its script."""

import html
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from muybridge.arrays import BoolArray, Float32Array, FloatArray
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.infer.viewer.packing import encode, pack_places
from muybridge.infer.viewer.page import component_style, embedded_json, filled, joined_scripts, page, read_asset
from muybridge.motion.editing.root_path import GroundPath
from muybridge.motion.matching.controller import SteerOptions
from muybridge.motion.matching.database import MatchDatabase

_STILL = 1e-3  # of a joint's quaternions: it does not move
_TURN_STEPS = 32767  # codes of a quaternion's component, from -sqrt(1/2) to sqrt(1/2)
_FEATURE_STEPS = 65535
_WALK = 1.3  # metres per second, if the clips have it


@dataclass(frozen=True)
class PageOptions:
    """What the page holds, and how the figure is steered there.

    Attributes:
        fps: frames per second of what it holds, at most; between them it interpolates.
        steer: how the figure is steered.
        halflife: seconds in which half of a change of velocity is done.
        turn_halflife: seconds in which half of a turn is done.
    """

    fps: float = 30.0
    steer: SteerOptions = SteerOptions()
    halflife: float = 0.25
    turn_halflife: float = 0.25


def render_match_page(database: MatchDatabase, name: str, options: PageOptions | None = None) -> str:
    """The page that lets a figure be steered.

    Args:
        database: of what the figure knows.
        name: of the database, for the title.
        options: what the page holds.
    """
    options = options or PageOptions()
    data = embedded_json(pack_database(thinned(database, options.fps), name, options))
    component = filled("steering.html", {"title": html.escape(name), "data": data})
    script = joined_scripts("maths.js", "drawing.js", "camera.js", "matching.js", "steering.js")
    style = f"{component_style()}\n{read_asset('steering.css')}"
    return page("muybridge match", name, style, component, script)


def thinned(database: MatchDatabase, fps: float) -> MatchDatabase:
    """The database with every second, third, ... frame alone, so that it has no more than so many a second."""
    step = max(1, int(np.ceil(database.fps / fps - 1e-6)))
    if step == 1:
        return database
    frames = [np.arange(a, b, step) for a, b in zip(database.starts[:-1], database.starts[1:], strict=True)]
    kept = np.concatenate(frames)
    motion = database.motion.select(kept)
    motion = type(motion)(motion.skeleton, motion.fps / step, motion.root_positions_world, motion.quat_wxyz,
                          motion.translations)  # fmt: skip
    return MatchDatabase(
        motion, database.names, np.cumsum([0, *map(len, frames)]),
        GroundPath(database.path.places[kept], database.path.yaw[kept]), database.features[kept],
        database.ignored[kept], database.roles, database.options,
    )  # fmt: skip


def pack_database(database: MatchDatabase, name: str, options: PageOptions) -> dict[str, Any]:
    """What the page's script gets, for JSON."""
    motion, skeleton = database.motion, database.motion.skeleton
    moving = np.abs(motion.quat_wxyz - motion.quat_wxyz[:1]).max(axis=(0, 2)) > _STILL
    moving |= np.array([parent < 0 for parent in skeleton.parents])
    scaling = database.scaling
    packed: dict[str, Any] = {
        "name": name,
        "fps": motion.fps,
        "frames": len(database),
        "clips": list(database.names),
        "starts": database.starts.tolist(),
        "stops": np.unique(database.ends).tolist(),
        "searchable": _runs(database.searchable),
        "horizons": list(database.options.horizons),
        "mean": scaling.mean.tolist(),
        "factor": scaling.factor.tolist(),
        "features": _pack_features(database.scaled),
        "path": encode(np.column_stack([database.path.places, database.path.yaw]), "<f4"),
        "parents": list(skeleton.parents),
        "sides": _sides(skeleton, database.roles),
        "offsets": np.round(skeleton.offsets, 6).tolist(),
        "tips": _tips(skeleton),
        "sliding": list(skeleton.sliding),
        "moving": np.flatnonzero(moving).tolist(),
        "still": np.round(motion.quat_wxyz[0], 6).tolist(),
        "turns": pack_turns(motion.quat_wxyz[:, moving]),
        "roots": pack_places(_facing_places(motion.root_positions_world, database.path)),
        "slides": None if motion.translations is None else pack_places(motion.translations),
        "steer": {
            "searchEvery": options.steer.search_every,
            "blend": options.steer.blend,
            "transitionCost": options.steer.transition_cost,
            "turning": options.steer.turning,
            "halflife": options.halflife,
            "turnHalflife": options.turn_halflife,
        },
        "speeds": speeds(database),
    }
    return packed


def speeds(database: MatchDatabase) -> dict[str, float]:
    """Metres per second: of a usual walk, as far as the clips have it, and the fastest that they have."""
    clip = database.clip_of(np.arange(len(database) - 1))
    inside = clip == database.clip_of(np.arange(1, len(database)))
    way = np.linalg.norm(np.diff(database.path.places, axis=0), axis=1)[inside] * database.fps
    slow, fast = np.percentile(way, [10, 98]) if len(way) else (_WALK, _WALK)
    walk = float(np.clip(_WALK, slow, max(fast, slow)))
    return {"walk": round(walk, 2), "fast": round(max(float(fast), walk), 2)}


def pack_turns(quat_wxyz: FloatArray) -> str:
    """(N, M, 4) unit quaternions as three numbers of 15 bits each.

    The largest component is left out: its sign is made positive, and which one it is stands in the highest bits of the
    first two numbers. The largest error is 0.01 degrees.
    """
    largest = np.abs(quat_wxyz).argmax(axis=-1)[..., None]
    sign = np.where(np.take_along_axis(quat_wxyz, largest, -1) < 0, -1.0, 1.0)
    rest = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])[largest[..., 0]]
    values = np.take_along_axis(quat_wxyz * sign, rest, -1) * np.sqrt(2.0)
    codes = np.round((np.clip(values, -1, 1) + 1) / 2 * _TURN_STEPS).astype(np.int64)
    codes[..., 0] |= (largest[..., 0] & 1) << 15
    codes[..., 1] |= (largest[..., 0] >> 1) << 15
    return encode(codes, "<u2")


def _pack_features(scaled: Float32Array) -> dict[str, Any]:
    """Columns as 16-bit integers between their limits."""
    values = scaled.astype(np.float64)
    low = values.min(axis=0)
    step = np.maximum(np.ptp(values, axis=0) / _FEATURE_STEPS, 1e-9)
    return {"low": low.tolist(), "step": step.tolist(), "data": encode(np.round((values - low) / step), "<u2")}


def _facing_places(places: FloatArray, path: GroundPath) -> FloatArray:
    """(N, 3) places in the facing frames of their own frames."""
    c, s = np.cos(path.yaw), np.sin(path.yaw)
    x, y = (places[:, :2] - path.places).T
    return np.stack([c * x + s * y, c * y - s * x, places[:, 2]], axis=1)


def _runs(mask: BoolArray) -> list[list[int]]:
    """First frame, and the one behind the last, of each run of true."""
    edges = np.flatnonzero(np.diff(mask.astype(np.int8), prepend=0, append=0))
    return np.asarray(edges).reshape(-1, 2).tolist()


def _sides(skeleton: Skeleton, roles: Mapping[str, int]) -> list[int]:
    """1 of joints of the left limbs, 2 of those of the right ones, else 0."""
    out = np.zeros(len(skeleton), np.int64)
    for value, side in ((1, "left_"), (2, "right_")):
        for role, joint in roles.items():
            if role.startswith(side):
                out[skeleton.is_ancestor[joint]] = value
    return out.tolist()


def _tips(skeleton: Skeleton) -> list[list[float] | None]:
    known = np.isfinite(skeleton.tips).all(axis=1) & (np.abs(np.nan_to_num(skeleton.tips)).max(axis=1) > 1e-6)
    return [np.round(tip, 6).tolist() if there else None for tip, there in zip(skeleton.tips, known, strict=True)]
