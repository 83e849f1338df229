"""`muybridge calibrate scan`: fixed cameras from photographs, or a video, taken while walking around the room."""

from pathlib import Path
from typing import Annotated

import tyro

from muybridge.geometry.calibration import save_calibration
from muybridge.geometry.calibration.structure_from_motion import ScanOptions
from muybridge.infer.pipelines.calibration.scan import calibrate_from_scan, format_summary
from muybridge.infer.results.ownership import check_replaceable
from muybridge.infer.runtime.progress import Progress

COMMON_OPTIONS = {
    "scan": (
        "cameras", "out", "overwrite", "distance", "between", "marker_size", "marker_id", "marker_on_floor", "lenses",
    )
}  # fmt: skip


def scan(
    photos: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="PHOTOS_OR_VIDEO")],
    /,
    cameras: Path,
    out: Path,
    overwrite: bool = False,
    between: Annotated[tuple[str, ...], tyro.conf.arg(metavar="CAMERA CAMERA")] = (),
    lenses: Path | None = None,
    max_photos: int = 80,
    model: Path | None = None,
    options: ScanOptions = ScanOptions(),  # noqa: B008 - frozen
) -> int:
    """Calibrate fixed cameras from photographs or a video taken while walking around the room.

    Example:
        muybridge calibrate scan photos/ --cameras recordings/walk/videos --marker-size 0.2 --out calibration.toml

    Args:
        photos: folder of photographs, or a video, all of one camera (a phone).
        cameras: folder with one video or image per fixed camera, named as the camera (a session's `videos/`).
        out: calibration file to write (TOML).
        overwrite: replace files there that muybridge did not write.
        between: the two cameras whose distance --distance gives.
        lenses: calibration file whose lenses the fixed cameras of the same names keep.
        max_photos: most photographs, sharp and evenly spread, that are taken from a video.
        model: folder to keep COLMAP's model in.
        options: options of the calibration.
    """
    check_replaceable([out] if model is None else [out, model], overwrite)
    with Progress() as progress:
        found, count = calibrate_from_scan(photos, cameras, options, progress, between, lenses, max_photos, model)
    save_calibration(found.cameras, out)
    print("\n".join([*format_summary(found, count), f"written to {out}"]))
    return 0
