"""The demo: a short rendered take, processed and compared with its ground truth."""

from dataclasses import dataclass
from importlib.resources.abc import Traversable
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.errors import OutputError
from muybridge.files import replacing
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.infer.demo_take.take import TAKE, demo_folder, true_points
from muybridge.infer.pipelines.videos import RunOptions, RunResult, run_session
from muybridge.infer.results.folder import is_ours
from muybridge.infer.runtime.progress import Progress


@dataclass(frozen=True)
class Score:
    """Distance of a result to the ground truth.

    Attributes:
        mpjpe_mm: mean over the frames and landmarks of the result; NaN if there are none.
        coverage: share of the ground truth's frames and landmarks that the result has.
    """

    mpjpe_mm: float
    coverage: float


def run_demo(
    out: Path, options: RunOptions, progress: Progress, folder: Traversable | None = None
) -> tuple[RunResult, Score]:
    """Copy the demo's take to `out/take`, process it into `out` and compare with the ground truth.

    Args:
        out: folder for the take and the results.
        options: the pipeline's.
        progress: receives progress messages.
        folder: a take like the demo's, to use instead.

    Raises:
        MuybridgeError: as `videos.run_session`.
    """
    folder = folder or demo_folder()
    points_world, names = true_points(folder)
    take = out / TAKE
    _copy(folder, take, options.overwrite or is_ours(out))
    result = run_session(take, out, options, progress)
    return result, score(result.solution.points, points_world, names)


def _copy(folder: Traversable, take: Path, ours: bool) -> None:
    """The take as a session folder; identical files stay, so that runs can resume.

    Args:
        folder: the take.
        take: the session folder.
        ours: whether the folder is from an earlier demo, or may be overwritten.

    Raises:
        OutputError: other files of these names are in the folder.
    """
    videos = sorted((v for v in folder.joinpath("videos").iterdir() if v.is_file()), key=lambda v: v.name)
    for source, target in [
        (folder.joinpath("calibration.toml"), take / "calibration.toml"),
        *((video, take / "videos" / video.name) for video in videos),
    ]:
        data = source.read_bytes()
        if target.is_file() and target.read_bytes() == data:
            continue
        if target.exists() and not ours:
            raise OutputError(f"{target} exists and is not the demo's; choose another --out")
        with replacing(target) as temporary:
            temporary.write_bytes(data)


def score(points: Points3D, truth_world: FloatArray, names: list[str]) -> Score:
    """Mean distance to the ground truth, without any alignment.

    Args:
        points: (T, J, 3) the result.
        truth_world: (T, K, 3) metres; NaN where there is no ground truth.
        names: (K,) the ground truth's landmarks, all of which the result must have.

    Raises:
        ValueError: another number of frames, or a landmark that the result does not have.
    """
    if len(points.points_world) != len(truth_world):
        raise ValueError(f"{len(points.points_world)} frames against a truth of {len(truth_world)}")
    columns = [points.landmarks.index(name) for name in names]
    distance = np.linalg.norm(points.points_world[:, columns] - truth_world, axis=-1)
    known = np.isfinite(truth_world).all(axis=-1)
    found = known & np.isfinite(distance)
    mpjpe = 1e3 * float(distance[found].mean()) if found.any() else float("nan")
    return Score(mpjpe, float(found.sum() / max(1, known.sum())))
