"""`muybridge adapt`: a keypoint network that gets used to a session's own people, clothes, cameras and light."""

from __future__ import annotations

import importlib.util
import json
import shlex
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from muybridge.errors import MissingExtraError, ModelError
from muybridge.extras import extra_of
from muybridge.infer.detection.detect import DetectOptions
from muybridge.infer.networks.models import open_models
from muybridge.infer.pipelines.pseudo_labels import collect
from muybridge.infer.pipelines.videos import ADAPTED, RunOptions, follow
from muybridge.infer.reconstruction.landmarks import SolveOptions
from muybridge.infer.results.folder import open_output
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import StageStore
from muybridge.infer.session.session import SessionOptions, open_session
from muybridge.models.keypoints.metadata import keypoint_card
from muybridge.models.pseudo_labels import save_pseudo_labels

RESULTS = ("keypoints.onnx", ADAPTED.name, "adapt.json")
_NEEDED = ("torch", "kornia", "onnx")

COMMON_OPTIONS = {"adapt": ("out", "overwrite", "minutes", "threads", "everyone", "calibration", "cameras")}


@dataclass(frozen=True)
class AdaptOptions:
    """How a network is adapted.

    Attributes:
        minutes: of training, after the people were found.
        threads: of training; default all processors.
        seed: of training.
    """

    minutes: float = 2.0
    threads: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.minutes > 0 or (self.threads is not None and self.threads < 1):
            raise ValueError("minutes must be more than 0, and threads at least 1")


def adapt(
    path: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(name="session", metavar="SESSION")],
    /,
    out: Path | None = None,
    overwrite: bool = False,
    everyone: bool = False,
    options: AdaptOptions = AdaptOptions(),  # noqa: B008 - frozen
    session: SessionOptions = SessionOptions(),  # noqa: B008
    detect: DetectOptions = DetectOptions(),  # noqa: B008
) -> int:
    """Adapt the keypoint network to a session, without a label: all cameras together teach it what each one sees.

    Needs the train extra. Minutes later, `muybridge run SESSION --keypoint-model adapted/keypoints-int8.onnx` uses it.

    Args:
        path: session folder, as of `muybridge run`; more cameras and more movement teach more.
        out: folder of the network (default: `adapted/` inside the session).
        overwrite: replace files there that muybridge did not write or that were changed.
        everyone: learn from the other people too whom two cameras see.
        options: how.
        session: how the session folder is read.
        detect: 2D landmarks, to begin with.
    """
    _check_extra()
    if detect.model_card is not None:
        raise ModelError("only muybridge's own networks can be adapted; leave out --model-card")
    base = replace(detect, precision="fp32", markers="all")
    run = RunOptions(session, base, SolveOptions(everyone=everyone), refine_cameras=True)
    with Progress() as progress:
        opened, models = open_session(path, session), open_models(base)
        card = keypoint_card(models.metadata["keypoints"], models.keypoints)
        if card.metadata.get("precision") == "int8":
            raise ModelError(f"{models.keypoints}: of 8 bits, which cannot be trained on; name the fp32 file beside it")
        inputs = [opened.calibration, *(v.path for v in opened.videos)]
        output = open_output(path / ADAPTED.parent if out is None else out, RESULTS, inputs, overwrite)
        followed = follow(opened, models, StageStore(output.work), run, progress)
        footage = output.work / "footage.npz"
        save_pseudo_labels(footage, collect(followed, card, progress))
    made = output.work / "trained"
    code = _train(footage, made, models.keypoints, options)
    if code:
        return code  # it said why
    for name in RESULTS:
        output.write(name, (made / name).replace)
    footage.unlink()
    print(_summary(json.loads((output.path / RESULTS[2]).read_text(encoding="utf-8"))))
    print("use it: " + shlex.join(["muybridge", "run", str(path), "--keypoint-model", str(output.path / RESULTS[1])]))
    return 0


def _check_extra() -> None:
    """MissingExtraError now rather than after the minutes that finding people takes."""
    missing = [name for name in _NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        extra = extra_of(missing[0]) or "train"
        raise MissingExtraError(
            f"`muybridge adapt` needs {missing[0]}, which is not installed; "
            f'install the extra: pip install "muybridge[{extra}]"'
        )


def _train(footage: Path, out: Path, model: Path, options: AdaptOptions) -> int:
    """Has `muybridge train adapt` train, in a process of its own, since nothing here knows a training library; its
    bar and its errors go where ours go. Returns its exit code."""
    command = [
        sys.executable, "-m", "muybridge", "train", "adapt", "--footage", footage, "--out", out, "--model", model,
        "--minutes", options.minutes, "--seed", options.seed,
        *(["--threads", options.threads] if options.threads else []),
    ]  # fmt: skip
    return subprocess.run([str(part) for part in command], check=False, stdout=subprocess.DEVNULL).returncode


def _summary(facts: dict[str, Any]) -> str:
    before, after = facts["before"], facts["after"]
    return (
        f"adapted to {facts['crops']} crops of {facts['frames']} frames: in frames kept apart, a landmark lies "
        f"{after['mean_px']:.1f} px of the network's crop from what all cameras agree on (mean; "
        f"{before['mean_px']:.1f} before), {after['median_px']:.1f} px at the median ({before['median_px']:.1f} before)"
    )
