"""The commands `run`, `run-markers` and `demo`."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import tyro

from muybridge.errors import SessionError
from muybridge.infer import pipelines
from muybridge.infer.commands.remedies import print_error
from muybridge.infer.pipelines.demo import run_demo
from muybridge.infer.pipelines.videos import RunCharacter, RunOptions, run_session, summary
from muybridge.infer.reconstruction.marker_videos import MarkerVideoOptions
from muybridge.infer.runtime.each import try_each
from muybridge.infer.runtime.logs import is_quiet
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import SessionOptions

COMMON_OPTIONS = {
    "run": (
        "out", "to", "preset", "overwrite", "calibration", "cameras", "markers", "workers", "min_confidence",
        "everyone", "world",
    ),
    "run_markers": ("out", "overwrite", "calibration", "cameras", "markerset", "correct"),
}  # fmt: skip

_Sessions = Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="SESSION ...")]


def run(
    sessions: _Sessions,
    /,
    out: Path | None = None,
    to: Annotated[Path | None, tyro.conf.arg(metavar="HERO")] = None,
    options: RunOptions = RunOptions(),  # noqa: B008 - frozen
) -> int:
    """Reconstruct 3D motion from session folders: videos and a calibration in, points and motion out.

    The results folder gets the 3D landmarks, the motion as BVH and glTF, videos with landmarks and skeleton overlaid,
    and `report.html`.

    Example:
        muybridge run recordings/walk --out results/walk

    Args:
        sessions: one or more folders, each with `videos/` (one file per camera) and a calibration.
        out: results folder (default: `muybridge/` inside the session). Several sessions each get a subfolder.
        to: file of a character (.glb, .vrm, .bvh, .fbx), which the motion is put onto as well: the results folder gets
            that file with a clip for each person (see `muybridge retarget`), and `report.html` shows it moving.
        options: options of every stage.
    """
    character = _character(to) if to is not None else None

    def work(path: Path, place: Path | None) -> str:
        with Progress() as progress:
            return summary(run_session(path, place, options, progress, character))

    return run_each(plan(sessions, out), work)


def _character(path: Path) -> RunCharacter:
    from muybridge.infer.commands.motion.run_character import read_run_character

    return read_run_character(path)


def run_markers(
    sessions: _Sessions,
    /,
    out: Path | None = None,
    overwrite: bool = False,
    session: SessionOptions = SessionOptions(),  # noqa: B008 - frozen
    options: MarkerVideoOptions = MarkerVideoOptions(),  # noqa: B008
) -> int:
    """Reconstruct 3D motion from videos of bright markers on a dark background.

    Markers are detected, matched between the cameras, labelled, and solved to a skeleton; the keypoint network is not
    used.

    Example:
        muybridge run-markers recordings/jump --markerset cmu41

    Args:
        sessions: one or more folders, each with `videos/` (one file per camera) and a calibration.
        out: results folder (default: `muybridge/` inside the session). Several sessions each get a subfolder.
        overwrite: replace files in the results folder that muybridge did not write or that were changed since.
        session: how session folders are read.
        options: how markers are detected, matched and solved.
    """

    def work(path: Path, place: Path | None) -> str:
        with Progress() as progress:
            return pipelines.run_marker_session(path, place, session, options, overwrite, progress).summary

    return run_each(plan(sessions, out), work)


def plan(sessions: Sequence[Path], out: Path | None) -> list[tuple[Path, Path | None]]:
    """Each session with its results folder; a session that is named twice is processed once.

    Raises:
        SessionError: no session is named.
    """
    if not sessions:
        raise SessionError("no session folder given; name at least one: muybridge run SESSION [SESSION ...]")
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


def run_each(jobs: Sequence[tuple[Path, Path | None]], work: Callable[[Path, Path | None], str]) -> int:
    """Process every session, whatever happens to the others, and print what `work` returns.

    Returns:
        The exit code: 2 where a session failed, 1 where that was a bug.

    Raises:
        MuybridgeError: the only session failed.
    """
    places = dict(jobs)

    def one(path: Path) -> None:
        print(work(path, places[path]), flush=True)

    tried = try_each([path for path, _ in jobs], one, print_error)
    if len(jobs) > 1:
        print(f"{len(tried.done)} of {len(jobs)} sessions done", flush=True)
    tried.report_failures("sessions")
    return tried.exit_code


def demo(out: Path = Path("muybridge-demo"), overwrite: bool = False) -> int:
    """Run the pipeline on the included demo take and print the error against its ground truth.

    Args:
        out: folder for the take and its results.
        overwrite: replace files in the results folder that muybridge did not write or that were changed since.
    """
    options = replace(RunOptions(), overwrite=overwrite)
    with Progress() as progress:
        result, score = run_demo(out, options, progress)
    if not is_quiet():
        print(summary(result))
    print(f"MPJPE {score.mpjpe_mm:.1f} mm")
    print(
        f"That is the mean distance to the ground truth, over the {score.coverage:.1%} of landmarks and frames that "
        f"were reconstructed. Results: {result.out}"
    )
    return 0
