"""What a run needs after its videos, made ready while it reads them.

A thread loads the modules of the later stages. Numba compiles kernels at their first use, which takes half a minute of
processor time after an installation: a process for each half of them does it. A process can be ended at any time and
does not hold Python's lock; its result reaches this process through numba's cache on disk.

`python -m muybridge.infer.pipelines.warm_up` compiles all of them, for installations that many start from.
"""

from __future__ import annotations

import contextlib
import importlib
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.calibration import load_calibration
from muybridge.geometry.cameras import _pycolmap as pycolmap
from muybridge.geometry.fitting import _banded_kernel, _chain_kernel, bone_lengths
from muybridge.geometry.fitting.body_fit import FitOptions, fitting_problem
from muybridge.geometry.fitting.gauss_newton import Pose, landmark_positions, solve_in_stretches
from muybridge.geometry.fitting.initial_pose import start_pose
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.numerics import banded, covariances
from muybridge.geometry.numerics._numba import is_compiled
from muybridge.geometry.skeleton.body import BODY, prior_shape
from muybridge.geometry.smoothing import _kernel as smoothing_kernel
from muybridge.geometry.smoothing.kalman import smooth_points
from muybridge.geometry.triangulation import _kernel as triangulation_kernel
from muybridge.geometry.triangulation.multiview import triangulate
from muybridge.infer.demo_take.take import demo_folder, true_points
from muybridge.infer.runtime.progress import Progress

_FRAMES, _FPS = 16, 25.0  # of the demo's take, which is solved to compile the kernels

# Slow to load, and used only when the first landmarks are there; in the order of their use.
LATER = ("scipy.optimize", "scipy.ndimage", "scipy.special", "scipy.linalg", "scipy.spatial",
         "muybridge.motion.contacts.find", "muybridge.infer.report.page")  # fmt: skip


class CompiledAhead:
    """Context manager that loads and compiles in the background what is not needed at once.

    Attributes:
        processes: that compile; none where all kernels are in the cache.
    """

    def __init__(self) -> None:
        self.processes: list[subprocess.Popen[bytes]] = []
        self._thread = threading.Thread(target=self._prepare, daemon=True)
        self._ended = threading.Event()

    def __enter__(self) -> CompiledAhead:
        self._thread.start()
        return self

    def _prepare(self) -> None:
        start_compiling(self.processes)
        pycolmap.load()
        for name in LATER:
            if not self._ended.is_set():
                importlib.import_module(name)

    def wait(self, progress: Progress) -> None:
        """Wait until all is loaded and compiled. Where compiling failed, this process does it."""
        self._thread.join()
        if any(process.poll() is None for process in self.processes):
            with progress.task("compiling numerical kernels (first run only)", 1):
                for process in self.processes:
                    process.wait()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()
        for process in self.processes:
            process.kill()
            process.wait()


def start_compiling(processes: list[subprocess.Popen[bytes]]) -> None:
    """Append a process for each part whose kernels are not all in the cache."""
    # A program frozen into one file has no interpreter to start.
    if not sys.executable or getattr(sys, "frozen", False):
        return
    for name, part in _PARTS.items():
        if not all(is_compiled(kernel) for kernel in part.kernels):
            command = [sys.executable, "-m", __spec__.name, name]
            with contextlib.suppress(OSError):
                processes.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))


def compile_points() -> None:
    """Triangulate and smooth a part of the demo's take from its true landmarks."""
    cameras = load_calibration(Path(str(demo_folder().joinpath("calibration.toml"))))
    px = cameras.project(_true_landmarks(BODY23.names))
    found = triangulate(cameras, px, np.where(np.isfinite(px).all(axis=-1), 1.0, np.nan))
    residual = np.full(found.inlier.shape, np.nan)
    smooth_points(Points3D(BODY23, found.points_world, found.covariance_world, residual, found.inlier, _FPS))
    covariances.squared_distances(found.points_world, found.covariance_world)


def compile_fit() -> None:
    """Fit the body to a part of the demo's true landmarks."""
    points = np.nan_to_num(_true_landmarks(BODY.landmark_names))
    shape, known = prior_shape(1.7), np.ones(points.shape[:2], dtype=np.bool_)
    covariance = np.tile(1e-4 * np.eye(3), (*known.shape, 1, 1))
    problem = fitting_problem(
        BODY, shape, points, covariance, 1.0, known, known.astype(np.float64), _FPS, FitOptions()
    )  # fmt: skip
    pose = solve_in_stretches(problem, Pose(*start_pose(BODY, shape, points)), 1)
    landmark_positions(problem, pose)
    _chain_kernel.rotations_of(problem.chain, pose.turn, pose.angles)
    bone_lengths.length_equations(problem, pose, BODY.joint_basis, BODY.landmark_basis)
    covariances.inverses(covariance)


def _true_landmarks(names: Sequence[str]) -> FloatArray:
    """(T, J, 3) metres: the first frames of the demo's take."""
    truth, known = true_points(demo_folder())
    return truth[:_FRAMES, [known.index(name) for name in names]].astype(np.float64)


class _Part(NamedTuple):
    """Kernels, and what compiles them."""

    kernels: tuple[Any, ...]
    compile: Callable[[], None]


# Parts that take about the same time, by the names that the processes are started with.
_PARTS = {
    "points": _Part(
        (
            triangulation_kernel.solve_points,
            smoothing_kernel.flipped_path,
            smoothing_kernel.smooth_all,
            covariances.measure_all,
        ),
        compile_points,
    ),
    "body": _Part(
        (
            _banded_kernel.total_cost,
            _banded_kernel.assemble,
            banded.solve_band,
            _chain_kernel.landmarks_of,
            _chain_kernel.rotations_of,
            bone_lengths.fill_equations,
            covariances.invert_all,
        ),
        compile_fit,
    ),
}


def main(names: Sequence[str]) -> int:
    """Compile the named parts here, or all of them in processes side by side; returns the exit code."""
    for name in names:
        _PARTS[name].compile()
    processes: list[subprocess.Popen[bytes]] = []
    if not names:
        start_compiling(processes)
    return max((process.wait() for process in processes), default=0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
