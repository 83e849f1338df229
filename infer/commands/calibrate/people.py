"""`muybridge calibrate people`: cameras of a session from the people in its videos."""

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.geometry.calibration import save_calibration
from muybridge.geometry.calibration.people.calibrate import PeopleCalibrationOptions
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.pipelines.calibration.people import calibrate_from_people, format_summary
from muybridge.infer.results.ownership import check_replaceable
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import SessionOptions

COMMON_OPTIONS = {"people": ("out", "overwrite", "refine", "height", "work", "calibration", "cameras", "workers")}


def people(
    path: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SESSION")],
    /,
    out: Path,
    overwrite: bool = False,
    refine: bool = True,
    work: Path | None = None,
    options: PeopleCalibrationOptions = PeopleCalibrationOptions(),  # noqa: B008 - frozen
    session: SessionOptions = SessionOptions(),  # noqa: B008
    detect: DetectOptions = DetectOptions(),  # noqa: B008
) -> int:
    """Calibrate cameras from the people in a session: refine a calibration, or estimate the poses from scratch.

    Example:
        muybridge calibrate people recordings/walk --out calibration.toml

    Args:
        path: session folder with `videos/` and a calibration, of which --no-refine uses only the lenses.
        out: calibration file to write (TOML); use it with `muybridge run SESSION --calibration FILE`.
        overwrite: replace files there that muybridge did not write.
        refine: start from the calibration's poses and keep its world; otherwise poses, scale and floor are estimated
            from the person.
        work: results folder whose 2D landmarks are used (default: `muybridge/` inside the session).
        options: options of the calibration.
        session: how the session folder is read.
        detect: 2D landmarks.
    """
    check_replaceable([out], overwrite)
    with Progress() as progress:
        found = calibrate_from_people(path, work, refine, options, session, detect, progress)
    save_calibration(found.result.cameras, out)
    print("\n".join(format_summary(found)))
    return 0
