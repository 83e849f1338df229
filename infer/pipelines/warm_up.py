"""Numba compiles our loops at their first use, which takes half a minute or a whole one after an installation: a
process of its own does it while the first run looks at its videos.

A process and not a thread, since it can be ended at any moment, and Python's lock is not shared with it; what it
compiled comes to this one through numba's cache on disk.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from muybridge.geometry.calibration import load_calibration
from muybridge.geometry.fitting import _banded_kernel as ik_band
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.geometry.smoothing import _kernel as smoothing_kernel
from muybridge.geometry.triangulation import _kernel as triangulation_kernel
from muybridge.infer.reconstruction import judge_calibration as calibration_stage
from muybridge.infer.reconstruction.landmarks import SolveOptions, solve
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import StageStore

# One of each stage, the last of it to be compiled.
_LOOPS = (triangulation_kernel.solve_points, smoothing_kernel.smooth_all, ik_band.assemble)
_FRAMES = 16  # of the take that is solved in order to compile everything


class CompiledAhead:
    """Within it our loops are compiled in the background, if they are not yet; used as a context manager.

    Attributes:
        process: that compiles; None where there is nothing to do.
    """

    process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> CompiledAhead:
        # Inside a program that was frozen into one file there is no interpreter to start.
        if sys.executable and not getattr(sys, "frozen", False) and not all(is_compiled(loop) for loop in _LOOPS):
            command = [sys.executable, "-m", __name__]
            with contextlib.suppress(OSError):
                self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return self

    def wait(self, progress: Progress) -> None:
        """Until it is done. Where it failed this process compiles for itself."""
        if self.process is not None and self.process.poll() is None:
            with progress.task("compiling, once after an installation", 1):
                self.process.wait()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()


def is_compiled(loop: Any) -> bool:
    """Whether a function of numba's lies compiled in its cache, or can't: without a cache nothing is gained ahead."""
    folder = getattr(getattr(loop, "stats", None), "cache_path", None)
    module = loop.__module__.rpartition(".")[2]
    return folder is None or any(Path(folder).glob(f"{module}.{loop.__name__}-*.nbi"))


def compile_now() -> None:
    """Solves a second of the demo's take, from where its landmarks truly are."""
    from muybridge.infer.demo_take.take import (  # which imports the pipeline, which imports this
        demo_folder,
        true_points,
    )

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
