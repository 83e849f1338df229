"""The labelling network as a function of trajectories: scores of every point for every label."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from muybridge.arrays import Float32Array, FloatArray, IndexArray
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.geometry.markers.tracking import Tracks
from muybridge.infer.networks.sessions import open_session
from muybridge.models.labelling.metadata import LabelModelCard, label_card
from muybridge.models.metadata_reader import metadata_of

LEAST_POINTS = 16


@dataclass(frozen=True)
class Cloud:
    """Windows of some frames, packed: existing points come first.

    Attributes:
        points: (B, 1 + W, N, 3) metres.
        seen: (B, 1 + W, N) 1 or 0.
        slot: (B, N) slot of the trajectories that a point comes from, -1 for padding.
    """

    points: Float32Array
    seen: Float32Array
    slot: IndexArray


class LabelNetwork:
    """A labelling network.

    Attributes:
        path: of the file.
        card: its metadata, parsed.
    """

    def __init__(self, path: Path, threads: int = 2, batch: int = 32) -> None:
        """Open the file.

        Batches run in parallel: threads within so small a network would mostly wait for one another.

        Raises:
            ModelError: the file is missing, damaged or no labelling network of muybridge's.
        """
        self.path, self._batch, self._threads = path, batch, threads
        self._session = open_session(path)
        self.card: LabelModelCard = label_card(metadata_of(self._session, path), path)

    def scores(self, tracks: Tracks, fps: float, asked: IndexArray, frames: IndexArray | None = None,
               turn: FloatArray | None = None, windowed: bool = True) -> Float32Array:  # fmt: skip
        """(F, S, A + 1) logarithm of the assignment of slots to the labels asked for, the last column for none; NaN
        where a slot holds no point.

        Args:
            tracks: trajectories.
            fps: frames per second.
            asked: (A,) positions in `SURFACE`.
            frames: which frames; all by default.
            turn: (3, 3) applied to the points first: rotation and scale.
            windowed: whether the network also takes the frames around.
        """
        frames = np.arange(len(tracks.points)) if frames is None else frames
        wanted = np.zeros(len(SURFACE), np.float32)
        wanted[asked] = 1
        columns = np.append(asked, len(SURFACE))
        out = np.full((len(frames), tracks.points.shape[1], len(columns)), np.nan, np.float32)

        def score(start: int) -> None:
            part = frames[start : start + self._batch]
            cloud = pack(tracks, part, fps, self.card.window if windowed else (), len(self.card.window))
            points = cloud.points if turn is None else (cloud.points @ turn.T.astype(np.float32))
            feed = {"points": points, "seen": cloud.seen, "asked": np.tile(wanted, (len(part), 1))}
            answer = self._session.run(None, feed)[0]
            b, n = np.nonzero(cloud.slot >= 0)
            out[start + b, cloud.slot[b, n]] = answer[b, n][:, columns]

        with ThreadPoolExecutor(self._threads) as pool:
            list(pool.map(score, range(0, len(frames), self._batch)))
        return out


def pack(tracks: Tracks, frames: IndexArray, fps: float, window: tuple[float, ...], size: int) -> Cloud:
    """The network's input for some frames; `size` is the width of the window, of which `window` (seconds) is filled."""
    there = tracks.track[frames] >= 0
    fullest = max(LEAST_POINTS, int(there.sum(1).max(initial=0)))
    order = np.argsort(~there, 1, kind="stable")[:, :fullest]
    if order.shape[1] < fullest:
        order = np.pad(order, ((0, 0), (0, fullest - order.shape[1])))
    valid = np.arange(fullest) < there.sum(1)[:, None]
    points = np.zeros((len(frames), 1 + size, fullest, 3), np.float32)
    seen = np.zeros((len(frames), 1 + size, fullest), np.float32)
    now = tracks.track[frames[:, None], order]
    for w, offset in enumerate((0.0, *window)):
        at = frames + round(offset * fps)
        inside = (at >= 0) & (at < len(tracks.points))
        at = np.clip(at, 0, len(tracks.points) - 1)
        same = valid & inside[:, None] & (tracks.track[at[:, None], order] == now)
        points[:, w] = np.where(same[..., None], tracks.points[at[:, None], order], 0.0)
        seen[:, w] = same
    return Cloud(points, seen, np.where(valid, order, -1))
