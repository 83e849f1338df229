"""Options that all training loops share. No torch here, so that help works without it."""

import pathlib
from dataclasses import dataclass
from typing import ClassVar

from muybridge.errors import SessionError


def check_output_folder(out: pathlib.Path) -> None:
    """Raise SessionError if `out` cannot be a folder because it, or one of its parents, is a file."""
    for path in (out, *out.parents):
        if path.exists() and not path.is_dir():
            raise SessionError(f"--out {out}: {path} is a file; name a folder")


@dataclass(frozen=True)
class Training:
    """How a network is trained.

    Attributes:
        renders: folder of the render store; rendered during training if it is empty. `muybridge synth` has more
            options.
        shards: number of shards of 256 renders to make if there are none. The first four are held out for validation;
            training starts once eight exist, while the rest are still being rendered. 0: make none.
        out: folder of checkpoints, logs and the finished ONNX file; an earlier run there is resumed.
        minutes: wall-clock time of this call's training, not counting the first renders and the backgrounds.
        steps: number of this call's steps, in place of `minutes`: then nothing depends on the time, and equal seeds and
            options give equal weights on a CPU. Renders are all made first.
        batch: images per step.
        rate: peak learning rate.
        muon: train convolution filters with Muon; otherwise AdamW trains everything, which takes a tenth less time and
            works as well for a network that has already been trained for long. A run resumed with the other setting
            keeps its weights but not its optimiser state.
        decay: share of the time, at the end, over which the learning rate falls.
        average: share of the run's steps, up to the last, over which weights are averaged if that is more than 2,000
            steps. 1, the mean of all steps, suits a network that has already been trained for long.
        threads: torch threads of the network; images are made by other processes.
        workers: processes that make images. Default: one; with a GPU, one per processor except one.
        backgrounds: number of backgrounds in the pool; half are painted, half are views of rendered rooms.
        seed: random seed.
    """

    renders: pathlib.Path = pathlib.Path("runs/renders")
    shards: int = 60
    out: pathlib.Path = pathlib.Path("runs/keypoints")
    minutes: float = 60.0
    steps: int | None = None
    batch: int = 64
    rate: float = 2e-3
    muon: bool = True
    decay: float = 0.2
    average: float = 0.0
    threads: int = 1
    workers: int | None = None
    backgrounds: int = 5000
    seed: int = 0

    @property
    def all_steps(self) -> int | None:
        """Number of steps of the whole run, over all calls, if that is given."""
        return None

    # Whether the network needs renders of whole people (close-ups cannot be used).
    whole_people: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if not 0 <= self.average <= 1:
            raise SessionError(f"--average {self.average:g}: must be a share of the steps, from 0 to 1")
        for name in ("minutes", "rate"):
            if not getattr(self, name) > 0:
                raise SessionError(f"--{name} {getattr(self, name):g}: must be above 0")
        for name, least in (
            ("steps", 1),
            ("batch", 1),
            ("threads", 1),
            ("workers", 0),
            ("backgrounds", 1),
            ("shards", 0),
        ):
            if (value := getattr(self, name)) is not None and value < least:
                raise SessionError(f"--{name} {value}: must be at least {least}")
        check_output_folder(self.out)

    @property
    def worthwhile_minutes(self) -> float:
        """How long the training takes, to decide what pays: a step is taken to last half a second."""
        return self.minutes if self.steps is None else self.steps / 120


@dataclass(frozen=True)
class ImageTraining(Training):
    """Training on images of people.

    Attributes:
        scene_renders: folders of further render stores to train on beside `renders`, such as of scenes of people and
            things. The first four shards of each are held out as well. Stores that still grow come last.
        scenes: share of the people who are drawn from renders of scenes, if there are any.
        images: number of images of the whole run, over all calls, in place of `minutes`: an interrupted run continues
            with the learning rate that it had.
    """

    scene_renders: tuple[pathlib.Path, ...] = ()
    scenes: float = 0.5
    images: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.scenes <= 1:
            raise SessionError(f"--scenes {self.scenes:g}: must be a share of the people, from 0 to 1")
        if self.images is not None and self.images < 1:
            raise SessionError(f"--images {self.images}: must be at least 1")
        if self.images is not None and self.steps is not None:
            raise SessionError("--images and --steps: both say how long to train; give one of them")

    @property
    def all_steps(self) -> int | None:
        """Number of steps of the whole run, if the number of images is given."""
        return None if self.images is None else -(-self.images // self.batch)

    @property
    def worthwhile_minutes(self) -> float:
        """As for every training."""
        return super().worthwhile_minutes if self.all_steps is None else self.all_steps / 120
