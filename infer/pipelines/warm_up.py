"""Compiling of numerical kernels in the background during the first run.

Numba compiles functions at their first use, which takes up to a minute after an installation. A separate process does
it while the first run reads its videos. A process can be ended at any time and does not hold Python's lock; its result
reaches this process through numba's cache on disk.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
from pathlib import Path
from types import TracebackType

import numpy as np

from muybridge.geometry.calibration import load_calibration
from muybridge.geometry.fitting import _banded_kernel as ik_band
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.numerics._numba import is_compiled
from muybridge.geometry.smoothing import _kernel as smoothing_kernel
from muybridge.geometry.triangulation import _kernel as triangulation_kernel
from muybridge.infer.demo_take.take import demo_folder, true_points
from muybridge.infer.reconstruction import judge_calibration as calibration_stage
from muybridge.infer.reconstruction.landmarks import SolveOptions, solve
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import StageStore

# One function per stage, the last of it to be compiled.
_KERNELS = (triangulation_kernel.solve_points, smoothing_kernel.smooth_all, ik_band.assemble)
_FRAMES = 16  # of the take that is solved to compile everything


class CompiledAhead:
    """Context manager that compiles numerical kernels in the background, if they are not in the cache.

    Attributes:
        process: that compiles; None where there is nothing to do.
    """

    process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> CompiledAhead:
        # A program frozen into one file has no interpreter to start.
        if sys.executable and not getattr(sys, "frozen", False) and not all(is_compiled(kernel) for kernel in _KERNELS):
            command = [sys.executable, "-m", __name__]
            with contextlib.suppress(OSError):
                self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return self

    def wait(self, progress: Progress) -> None:
        """Wait until compiling is done. Where it failed, this process compiles for itself."""
        if self.process is not None and self.process.poll() is None:
            with progress.task("compiling numerical kernels (first run only)", 1):
                self.process.wait()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()


def compile_now() -> None:
    """Solve a part of the demo's take from its true landmarks, which compiles every kernel."""
    cameras = load_calibration(Path(str(demo_folder().joinpath("calibration.toml"))))
    truth, names = true_points(demo_folder())
    world = truth[:_FRAMES, [names.index(name) for name in BODY23.names]]
    px = cameras.project(world)[:, :, None]
    known = np.isfinite(px).all(axis=-1)
    keypoints = Keypoints2D(BODY23, px, np.where(known, 1.0, np.nan), np.where(known, 1.0, 0.0))
    with tempfile.TemporaryDirectory() as folder, Progress(quiet=True) as progress:
        store = StageStore(Path(folder))
        calibration_stage.judge(cameras, keypoints, 25.0, "", store, progress)
        solve(cameras, {BODY23.name: keypoints}, 25.0, "", store, SolveOptions(), progress)


if __name__ == "__main__":
    compile_now()
