"""`muybridge adapt`: a keypoint network adapted to a session's own people, clothes, cameras and light."""

import importlib.util
import shlex
from pathlib import Path
from typing import Annotated

import tyro

from muybridge.errors import MissingExtraError
from muybridge.extras import extra_of
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.pipelines.adapt import AdaptOptions, TrainingFailed, adapt_session, format_summary
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.session.session import SessionOptions

_NEEDED = ("torch", "kornia", "onnx")
COMMON_OPTIONS = {"adapt": ("out", "overwrite", "minutes", "threads", "everyone", "calibration", "cameras")}


def adapt(
    path: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SESSION")],
    /,
    out: Path | None = None,
    overwrite: bool = False,
    options: AdaptOptions = AdaptOptions(),  # noqa: B008 - frozen
    session: SessionOptions = SessionOptions(),  # noqa: B008
    detect: DetectOptions = DetectOptions(),  # noqa: B008
) -> int:
    """Adapt the keypoint network to a session; no labels needed.

    The agreement of all cameras teaches the network what each camera sees. Needs the extra `train`.

    Example:
        muybridge adapt recordings/walk

    Args:
        path: session folder, as of `muybridge run`; more cameras and more movement teach more.
        out: folder of the network (default: `adapted/` inside the session).
        overwrite: replace files there that muybridge did not write or that were changed since.
        options: how the network is adapted.
        session: how the session folder is read.
        detect: 2D landmarks to begin with.
    """
    _check_extra()
    try:
        with Progress() as progress:
            network, facts = adapt_session(path, out, options, session, detect, overwrite, progress)
    except TrainingFailed as failure:
        return failure.code  # the process has printed its error
    print(format_summary(facts))
    print("use it: " + shlex.join(["muybridge", "run", str(path), "--keypoint-model", str(network)]))
    return 0


def _check_extra() -> None:
    """Raise MissingExtraError before the minutes that finding people takes, not after them."""
    missing = [name for name in _NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        extra = extra_of(missing[0]) or "train"
        raise MissingExtraError(
            f"`muybridge adapt` needs {missing[0]}, which is not installed; "
            f'install the extra: pip install "muybridge[{extra}]"'
        )
