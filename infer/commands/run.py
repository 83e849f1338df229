"""The commands `run` and `demo`."""

import sys
import traceback
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from muybridge.errors import MuybridgeError, SessionError
from muybridge.geometry.association.select import TrackingOptions
from muybridge.geometry.fitting.body_fit import FitOptions
from muybridge.geometry.smoothing.kalman import SmoothOptions
from muybridge.geometry.triangulation.left_right import FlipOptions
from muybridge.geometry.triangulation.multiview import TriangulateOptions
from muybridge.geometry.triangulation.shape_prior import PosePriorOptions
from muybridge.geometry.triangulation.view_bias import ViewBiasOptions
from muybridge.infer.commands.remedies import error_line
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.detection.refine import RefinementOptions
from muybridge.infer.pipelines.demo import run_demo
from muybridge.infer.pipelines.marker_videos import run_marker_session
from muybridge.infer.pipelines.videos import RunOptions, run_session, summary
from muybridge.infer.reconstruction.landmarks import SolveOptions
from muybridge.infer.reconstruction.marker_videos import MarkerVideoOptions
from muybridge.infer.results.overlay import OverlayOptions
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import SessionOptions

_Flat = tyro.conf.arg(name="")


def run(
    sessions: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="SESSION ...")],
    /,
    out: Path | None = None,
    overwrite: bool = False,
    quiet: bool = False,
    session: Annotated[SessionOptions, _Flat] = SessionOptions(),  # noqa: B008 - frozen
    detect: Annotated[DetectOptions, _Flat] = DetectOptions(),  # noqa: B008
    person: TrackingOptions = TrackingOptions(),  # noqa: B008
    refinement: RefinementOptions = RefinementOptions(),  # noqa: B008
    flips: FlipOptions = FlipOptions(),  # noqa: B008
    triangulate: TriangulateOptions = TriangulateOptions(),  # noqa: B008
    view_bias: ViewBiasOptions = ViewBiasOptions(),  # noqa: B008
    pose_prior: PosePriorOptions = PosePriorOptions(),  # noqa: B008
    smooth: SmoothOptions = SmoothOptions(),  # noqa: B008
    fit: FitOptions = FitOptions(),  # noqa: B008
    min_confidence: float | None = SolveOptions.min_confidence,
    fill_share: float = SolveOptions.fill_share,
    everyone: bool = False,
    refine_cameras: bool = False,
    world: Literal["calibration", "upright"] = RunOptions.world,
    markers_in_video: bool = False,
    marker_video: MarkerVideoOptions = MarkerVideoOptions(),  # noqa: B008
    overlay: OverlayOptions = OverlayOptions(),  # noqa: B008
) -> int:
    """Motion from session folders: videos and a calibration in; points, motion, overlays and a report out.

    Args:
        sessions: one or more folders, each with `videos/` (one file a camera) and a calibration.
        out: results folder (default: `muybridge/` inside the session). With several sessions, each gets a
            folder of its name in it.
        overwrite: replace files in the results folder that muybridge did not write or that were changed.
        quiet: say only what should be known and the results.
        session: how session folders are read.
        detect: 2D landmarks.
        person: which person is followed.
        refinement: views that lack the person, looked at again where the others know them to be.
        flips: left and right, where one camera has exchanged them.
        triangulate: 3D points.
        view_bias: where the network puts a landmark from this side and from that, learned from the take.
        pose_prior: what the rest of the body and of the take say about a point.
        smooth: points over time.
        fit: skeleton and joint angles.
        min_confidence: a landmark of which no camera is as sure as this, in 0..1, is not taken for measured: people of
            whom all cameras have a part alone are not made whole. 0 to take every guess. If not given: 0.5 with our
            network, what its card says with another.
        fill_share: a landmark that the cameras do not agree on is taken from the fitted body in frames where at
            least this share of the landmarks was measured; above 1, never.
        refine_cameras: first make the calibration's poses better by the person; the report says what it gained.
        world: whose axes results have: the calibration's, or turned upright where its Z axis is not up.
        everyone: write the other people whom two cameras see, too: `points_2.trc`, `motion_2.bvh` and so on.
        markers_in_video: the videos are of bright markers on a dark picture: they are found, matched, named and solved,
            without the keypoint network.
        marker_video: how, then.
        overlay: videos with what was found drawn in.
    """
    if not sessions:
        raise SessionError("name at least one session folder: muybridge run FOLDER [FOLDER ...]")
    if markers_in_video:
        for path, place in plan(sessions, out):
            with Progress(quiet=quiet) as progress:
                marked = run_marker_session(path, place, session, marker_video, overwrite, progress)
                print(marked.summary, flush=True)
        return 0
    solve = SolveOptions(
        person, flips, triangulate, view_bias, pose_prior, smooth, fit, min_confidence, fill_share, everyone
    )
    options = RunOptions(session, detect, solve, refinement, overlay, refine_cameras, world, overwrite)
    jobs = plan(sessions, out)
    if len(jobs) == 1:
        with Progress(quiet=quiet) as progress:
            result = run_session(*jobs[0], options, progress)
        print(summary(result))
        return 0
    return _run_many(jobs, options, quiet)


def plan(sessions: Sequence[Path], out: Path | None) -> list[tuple[Path, Path | None]]:
    """Each session with its results folder; a session that is named twice is worked on once."""
    by_place: dict[Path, Path] = {}
    for path in sessions:
        by_place.setdefault(path.resolve(), path)
    unique = list(by_place.values())
    if out is None or len(unique) == 1:
        return [(path, out) for path in unique]
    names = [path.resolve().name for path in unique]
    twice = {name for name, n in Counter(names).items() if n > 1}
    named = [
        f"{path.resolve().parent.name}-{name}" if name in twice else name
        for path, name in zip(unique, names, strict=True)
    ]
    seen: Counter[str] = Counter()
    jobs: list[tuple[Path, Path | None]] = []
    for path, name in zip(unique, named, strict=True):
        seen[name] += 1
        jobs.append((path, out / (name if seen[name] == 1 else f"{name}-{seen[name]}")))
    return jobs


def _run_many(jobs: Sequence[tuple[Path, Path | None]], options: RunOptions, quiet: bool) -> int:
    """Work on every session, whatever happens to the others; returns the exit code."""
    failed: list[Path] = []
    bug = False
    for path, out in jobs:
        try:
            with Progress(quiet=quiet) as progress:
                print(summary(run_session(path, out, options, progress)), flush=True)
        except MuybridgeError as error:
            print(f"error: {error_line(error)}", file=sys.stderr, flush=True)
            failed.append(path)
        except Exception:
            traceback.print_exc()
            failed.append(path)
            bug = True
    print(f"{len(jobs) - len(failed)} of {len(jobs)} sessions done", flush=True)
    if failed:
        names = ", ".join(str(p) for p in failed)
        print(f"error: {len(failed)} of {len(jobs)} sessions failed: {names}; see above", file=sys.stderr)
    return 1 if bug else 2 if failed else 0


def demo(out: Path = Path("muybridge-demo"), overwrite: bool = False, quiet: bool = False) -> int:
    """Run everything on the small take that comes along, and say how far it is from the truth.

    Args:
        out: where the take and its results go.
        overwrite: replace files in the results folder that muybridge did not write or that were changed.
        quiet: say only the figures.
    """
    options = replace(RunOptions(), overwrite=overwrite)
    with Progress(quiet=quiet) as progress:
        result, score = run_demo(out, options, progress)
    if not quiet:
        print(summary(result))
    print(f"MPJPE {score.mpjpe_mm:.1f} mm")
    print(
        f"That is the mean distance to the truth, over the {score.coverage:.1%} of landmarks and frames that "
        f"were found. Results: {result.out}"
    )
    return 0
