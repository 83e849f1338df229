"""What every kind of run has in common: a checked results folder, stages, files, and `run.json` at the end."""

import logging
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.results.folder import OutputFolder, open_output
from muybridge.infer.results.record import RUN, Kind, RunRecord, write_record
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import StageResult, StageStore
from muybridge.motion.formats.gltf.write import write_glb
from muybridge.motion.formats.points.c3d import C3DTake, write_c3d
from muybridge.motion.formats.points.trc import write_trc
from muybridge.motion.formats.skeletal.bvh import write_bvh
from muybridge.motion.formats.skeletal.mot import write_mot

_log = logging.getLogger(__name__)

# Results of earlier versions, which `run.json` has replaced.
_FORMER = ("solve.json", "markers.json")
_POINTS: Mapping[str, Callable[[Path, Any], object]] = {".trc": write_trc, ".c3d": write_c3d}
_MOTIONS: Mapping[str, Callable[[Path, Motion], object]] = {".bvh": write_bvh, ".glb": write_glb, ".mot": write_mot}


class Run:
    """A run's results folder and what goes into it.

    Attributes:
        kind: what went in.
        output: the results folder.
        store: finished stages.
        progress: receives progress messages.
        stages: finished stages by name, in order.
        written: names of the files written so far.
    """

    def __init__(
        self, kind: Kind, out: Path, names: Sequence[str], inputs: Iterable[Path], overwrite: bool,
        progress: Progress, session: Path | None = None,
    ) -> None:  # fmt: skip
        """Check the results folder and make it.

        Args:
            kind: what goes in.
            out: the results folder.
            names: every file that may be written there.
            inputs: files that are read; results never go over them.
            overwrite: replace files of these names that muybridge did not write.
            progress: receives progress messages.
            session: whose results they are, where a session goes in.

        Raises:
            OutputError: results cannot go there.
        """
        self._start, self._started = time.perf_counter(), datetime.now(UTC)
        self.kind, self.progress = kind, progress
        self.output: OutputFolder = open_output(out, (*names, RUN), inputs, overwrite, session)
        self.store = StageStore(self.output.work)
        self.stages: dict[str, StageResult] = {}
        self.written: list[str] = []

    def write(self, name: str, write: Callable[[Path], object]) -> None:
        """Let `write` make the file of this name.

        Raises:
            OutputError: it cannot be written.
        """
        self.output.write(name, write)
        self.written.append(name)

    def write_points(self, files: Mapping[str, Points3D | C3DTake]) -> None:
        """Write points under names whose suffix says the format: .trc or .c3d; the latter may have events."""
        for name, points in files.items():
            self.write(name, partial(_write_points, points=points))

    def write_motion(self, names: Iterable[str], motion: Motion) -> None:
        """Write one motion under names whose suffix says the format: .bvh, .glb or .mot."""
        for name in names:
            self.write(name, partial(_write_motion, motion=motion))

    @property
    def timings_s(self) -> dict[str, float]:
        """Seconds by stage."""
        return {name: stage.seconds for name, stage in self.stages.items()}

    def finish(self, former: Iterable[str] = (), **facts: Any) -> float:
        """Remove results of earlier runs that this one does not have, and write `run.json`.

        Args:
            former: names of files that an earlier run may have written.
            facts: further fields of `RunRecord`.

        Returns:
            Seconds that the run took.
        """
        kept = {*self.written, RUN}
        self.output.retire(name for name in (*former, *_FORMER) if name not in kept)
        seconds = time.perf_counter() - self._start
        record = RunRecord(kind=self.kind, started=self._started, seconds=seconds, results=tuple(self.written),
                           stages=self.stages, **facts)  # fmt: skip
        write_record(self.output, record)
        _log.info("%s: %d files in %.1f s", self.output.path, len(self.written) + 1, seconds)
        return seconds


def _write_points(path: Path, points: Points3D | C3DTake) -> None:
    _POINTS[path.suffix](path, points)


def _write_motion(path: Path, motion: Motion) -> None:
    _MOTIONS[path.suffix](path, motion)
