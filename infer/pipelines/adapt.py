"""A keypoint network adapted to the people, clothes, cameras and light of a session."""

import json
import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from muybridge.errors import ModelError
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

FACTS = "adapt.json"
RESULTS = ("keypoints.onnx", ADAPTED.name, FACTS)


@dataclass(frozen=True)
class AdaptOptions:
    """How a network is adapted.

    Attributes:
        minutes: training time, after the people are found.
        threads: of training; if not given, all processors.
        seed: of training.
        everyone: also learn from the other people whom two cameras see.
    """

    minutes: float = 2.0
    threads: int | None = None
    seed: int = 0
    everyone: bool = False

    def __post_init__(self) -> None:
        if not self.minutes > 0 or (self.threads is not None and self.threads < 1):
            raise ValueError("minutes must be more than 0, and threads at least 1")


class TrainingFailed(Exception):
    """The training process failed and has said why.

    Attributes:
        code: its exit code.
    """

    def __init__(self, code: int):
        super().__init__(f"training ended with exit code {code}")
        self.code = code


def adapt_session(
    path: Path,
    out: Path | None,
    options: AdaptOptions,
    session: SessionOptions,
    detect: DetectOptions,
    overwrite: bool,
    progress: Progress,
) -> tuple[Path, dict[str, Any]]:
    """Adapt the keypoint network to a session.

    Args:
        path: the session's folder.
        out: folder of the network; None for `adapted/` inside the session.
        options: of the adaptation.
        session: how the session folder is read.
        detect: how 2D landmarks are detected to begin with; the network that is adapted is the one of `detect`.
        overwrite: replace files in the folder that muybridge did not write.
        progress: receives progress messages.

    Returns:
        The adapted 8-bit network, and facts about the adaptation.

    Raises:
        MuybridgeError: the session or the network cannot be used, or the folder cannot be written.
        TrainingFailed: the training process failed.
    """
    if detect.model_card is not None:
        raise ModelError("only muybridge's own networks can be adapted", remedy="no_model_card")
    base = replace(detect, precision="fp32", markers="all")
    run = RunOptions(session=session, detect=base, solve=SolveOptions(everyone=options.everyone), refine_cameras=True)
    opened, models = open_session(path, session), open_models(base)
    card = keypoint_card(models.metadata["keypoints"], models.keypoints)
    if card.metadata.get("precision") == "int8":
        raise ModelError(f"{models.keypoints}: an 8-bit network, which cannot be trained; name the fp32 file beside it")
    inputs = [opened.calibration, *(v.path for v in opened.videos)]
    output = open_output(path / ADAPTED.parent if out is None else out, RESULTS, inputs, overwrite)
    followed = follow(opened, models, StageStore(output.work), run, progress)
    footage = output.work / "footage.npz"
    save_pseudo_labels(footage, collect(followed, card, progress))
    trained = output.work / "trained"
    _train(footage, trained, models.keypoints, options)
    for name in RESULTS:
        output.write(name, (trained / name).replace)
    footage.unlink()
    return output.path / ADAPTED.name, json.loads((output.path / FACTS).read_text(encoding="utf-8"))


def _train(footage: Path, out: Path, model: Path, options: AdaptOptions) -> None:
    """Train in a process of its own, `muybridge train adapt`, because inference imports no training library. Its
    progress and its errors appear where ours do."""
    command = [
        sys.executable, "-m", "muybridge", "train", "adapt", "--footage", footage, "--out", out, "--model", model,
        "--minutes", options.minutes, "--seed", options.seed,
        *(["--threads", options.threads] if options.threads else []),
    ]  # fmt: skip
    code = subprocess.run([str(part) for part in command], check=False, stdout=subprocess.DEVNULL).returncode
    if code:
        raise TrainingFailed(code)


def format_summary(facts: dict[str, Any]) -> str:
    """The gain of the adaptation in one sentence."""
    before, after = facts["before"], facts["after"]
    return (
        f"adapted to {facts['crops']} crops of {facts['frames']} frames; in held-out frames, a landmark lies "
        f"{after['mean_px']:.1f} px of the network's crop from the position that all cameras agree on (mean; "
        f"{before['mean_px']:.1f} before), {after['median_px']:.1f} px at the median ({before['median_px']:.1f} before)"
    )
