"""A session folder to motion, in one call."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from muybridge.api.callbacks import CallbackProgress, ProgressCallback
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.marker_sets import MarkerChoice
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.pipelines.videos import RunOptions, run_session
from muybridge.infer.reconstruction.landmarks import Solution
from muybridge.infer.reconstruction.quality import Quality
from muybridge.infer.reconstruction.virtual_markers import marker_set
from muybridge.infer.results.people import contacts_of, with_contacts, written_people
from muybridge.motion.formats.registry import write_file
from muybridge.motion.take import Take


@dataclass(frozen=True, eq=False)
class CapturedPerson:
    """One person of a take.

    Attributes:
        points: smoothed 3D points by the name of their landmark set: `body23` always, and the virtual markers of the
            skin under the name of their marker set where `options.detect.markers` asks for them.
        motion: the fitted skeleton over time; None where the points do not suffice for one, which only happens to
            people other than the first.
        quality: how far the result can be trusted, without knowing the truth.
    """

    points: Mapping[str, Points3D]
    motion: Motion | None
    quality: Quality

    def save(self, path: str | os.PathLike[str], *, landmarks: str = "body23") -> None:
        """Write the points or the motion to a file; the suffix decides the format.

        Points: .trc, .c3d, .csv, .parquet, .npz. Motion: .bvh, .glb, .fbx, .usda, .amc, .mot. An existing file is
        replaced.

        Args:
            path: the file.
            landmarks: which of `points` a format of points gets.

        Raises:
            ValueError: `points` has no such landmark set.
            FormatError: the suffix is of no format that can be written, or needs a motion and there is none.
            OutputError: the file cannot be written.

        Example:
            >>> import muybridge
            >>> result = muybridge.capture("session")
            >>> result.people[0].save("walk.trc")
        """
        if landmarks not in self.points:
            raise ValueError(f"no landmark set {landmarks!r} in this result: choose one of {', '.join(self.points)}")
        points, c3d = self.points[landmarks], None
        if landmarks == "body23" and Path(path).suffix.lower() == ".c3d":
            c3d = with_contacts(points, contacts_of(self.motion))
        write_file(Path(path), Take(points=points, motion=self.motion, c3d=c3d))


@dataclass(frozen=True, eq=False)
class Result:
    """A captured take.

    Attributes:
        folder: the results folder: the files that the command line writes too (points, motion, overlays, the report
            `report.html`, `run.json`).
        people: everybody who was written, the person of interest first; more than one only with
            `options.solve.everyone`.
        cameras: the C cameras as used.
        notices: what was assumed or worked around, a sentence each.
        problems: what spoils the result, a sentence each, as the report has them; empty for a good take.
        seconds: how long this run took.
    """

    folder: Path
    people: tuple[CapturedPerson, ...]
    cameras: CameraGroup
    notices: tuple[str, ...]
    problems: tuple[str, ...]
    seconds: float

    @property
    def points(self) -> Mapping[str, Points3D]:
        """3D points of the person of interest by the name of their landmark set, see `CapturedPerson.points`."""
        return self.people[0].points

    @property
    def motion(self) -> Motion:
        """The motion of the person of interest: metres, Z up, quaternions (w, x, y, z)."""
        motion = self.people[0].motion
        assert motion is not None  # `capture` raises where there is none
        return motion

    @property
    def quality(self) -> Quality:
        """How far the result of the person of interest can be trusted."""
        return self.people[0].quality

    def save(self, path: str | os.PathLike[str], *, landmarks: str = "body23") -> None:
        """Write the person of interest to a file of any format, see `CapturedPerson.save`.

        Raises:
            ValueError: `points` has no such landmark set.
            FormatError: the suffix is of no format that can be written.
            OutputError: the file cannot be written.

        Example:
            >>> import muybridge
            >>> result = muybridge.capture("session")
            >>> result.save("walk.bvh")
        """
        self.people[0].save(path, landmarks=landmarks)


def capture(
    folder: str | os.PathLike[str],
    *,
    out: str | os.PathLike[str] | None = None,
    options: RunOptions | None = None,
    progress: ProgressCallback | None = None,
) -> Result:
    """Run the whole pipeline on one session folder: videos and a calibration in, points and motion out.

    The same as the command `muybridge run`, with the same files. A run that was stopped, or that is called again with
    other options, resumes from the last stage whose inputs are the same. Nothing is printed: messages go to the log
    named `muybridge` of Python's `logging`.

    Args:
        folder: the session: `videos/`, one file a camera, and a calibration of any format that `load_calibration`
            reads.
        out: the results folder; by default `muybridge/` inside the session.
        options: of every stage; the defaults where it is None.
        progress: called as `progress(stage, done, total, seconds_left)` while it works, `seconds_left` being those of
            this stage and None while unknown. It may be called from another thread, one call at a time. To cancel,
            return False or raise; what was finished stays on disk for the next run.

    Returns:
        World coordinates are the calibration's, in metres, unless `options.world` turns them upright.

    Raises:
        SessionError: the folder cannot be used as it is, nobody is in it, or no body fits what is.
        VideoError: a video is truncated or cannot be decoded.
        CalibrationError: there is no calibration, there are several, or one that cannot be read.
        ModelError: a network named in `options` is missing or unusable.
        OutputError: the results cannot be written, or would replace files that are not muybridge's.
        CaptureCancelled: `progress` returned False.

    Example:
        >>> import muybridge
        >>> result = muybridge.capture("session", progress=lambda stage, done, total, seconds_left: True)
        >>> result.points["body23"].points_world.shape  # frames, landmarks, xyz
        (48, 23, 3)
        >>> result.quality.reprojection_px < 5
        True
        >>> result.save("walk.c3d")
    """
    options = options or RunOptions()
    run = run_session(Path(folder), None if out is None else Path(out), options, CallbackProgress(progress))
    people = written_people(run.solution)
    qualities = (run.quality, *run.others)
    return Result(
        folder=run.out,
        people=tuple(_person(p, q, options.detect.markers) for p, q in zip(people, qualities, strict=True)),
        cameras=run.session.cameras,
        notices=tuple(run.session.notices),
        problems=run.problems,
        seconds=run.seconds,
    )


def _person(solution: Solution, quality: Quality, markers: MarkerChoice) -> CapturedPerson:
    sets = [solution.points]
    if solution.markers is not None:
        sets.append(marker_set(solution.markers, markers))
    return CapturedPerson({points.landmarks.name: points for points in sets}, solution.motion, quality)
