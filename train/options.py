"""Options of the training commands: no torch here, so that their help works without it."""

import pathlib
from dataclasses import dataclass
from typing import ClassVar, Literal

from muybridge.errors import SessionError


def _refuse_file(out: pathlib.Path) -> None:
    """SessionError where a folder cannot be made."""
    for path in (out, *out.parents):
        if path.exists() and not path.is_dir():
            raise SessionError(f"--out {out}: {path} is a file; name a folder")


@dataclass(frozen=True)
class Adaptation:
    """How a keypoint network is trained on footage that nobody labelled.

    Attributes:
        footage: crops with what all cameras agree on, which `muybridge adapt` writes.
        out: folder of the finished ONNX files.
        model: fp32 network to begin with; default the shipped one.
        minutes: wall-clock time.
        batch: images a step.
        rate: peak learning rate; it rises over the first steps and falls over the second half of the time.
        threads: torch threads; default all processors.
        seed: of everything; how far it goes depends on the time all the same.
    """

    footage: pathlib.Path
    out: pathlib.Path
    model: pathlib.Path | None = None
    minutes: float = 2.0
    batch: int = 32
    rate: float = 3e-4
    threads: int | None = None
    seed: int = 0


@dataclass(frozen=True)
class Synthesis:
    """How the store of renders is made.

    Attributes:
        out: folder of the store; shards that are there already stay.
        shards: how many shards of 256 renders there shall be; the first four are held out from training.
        seed: shard k depends on the seed and k alone.
        kinds: people in these kinds of generated motion alone (stand, walk, sit, ...), of new shards; else in all, and
            in poses that are wider than motion's.
        close_ups: new shards are of parts of people, seen near, as cameras on a desk see them.
        processes: that render, of 0.9 GB each; as many as there are processors if not given, in half of the memory.
        sheet: also composites a contact sheet of training images, `sheet.png`, into the folder.
    """

    out: pathlib.Path = pathlib.Path("runs/renders")
    shards: int = 60
    seed: int = 0
    kinds: tuple[str, ...] = ()
    close_ups: bool = False
    processes: int | None = None
    sheet: bool = True

    def __post_init__(self) -> None:
        if self.shards < 1:
            raise SessionError(f"--shards {self.shards}: 1 at least")
        _refuse_file(self.out)


@dataclass(frozen=True)
class Training:
    """How a network is trained.

    Attributes:
        renders: folder of the render store, made where there is none; `muybridge synth` has more choices.
        shards: how many shards of 256 renders are made where there are none; the first four are held out from training,
            and training begins with the eighth, while the others are still being made. 0: none are made.
        out: folder of checkpoints, logs and the finished ONNX file; a run there is resumed.
        minutes: wall-clock time of this call's training, once the first renders and the backgrounds are there.
        batch: images a step.
        rate: peak learning rate.
        muon: the filters of convolutions are trained with Muon; else AdamW trains them too, in a tenth less time and as
            well where a network has long been trained and goes on. A run that is resumed with the other one keeps its
            weights alone.
        decay: share of the time, at its end, over which the learning rate falls.
        average: share of the run's steps, up to the last, over which weights are averaged where that is more than 2,000
            steps: 1, the mean of all, suits a network that has long been trained and goes on.
        threads: torch threads of the network; further processes make the images.
        workers: processes that make the images; if not given one, where a GPU trains one for every processor but one.
        backgrounds: how many backgrounds the pool holds; half are painted, half are views of rendered rooms.
        seed: of everything.
    """

    renders: pathlib.Path = pathlib.Path("runs/renders")
    shards: int = 60
    out: pathlib.Path = pathlib.Path("runs/keypoints")
    minutes: float = 60.0
    batch: int = 64
    rate: float = 2e-3
    muon: bool = True
    decay: float = 0.2
    average: float = 0.0
    threads: int = 1
    workers: int | None = None
    backgrounds: int = 5000
    seed: int = 0

    # Whether parts of people alone are of no use.
    whole: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if not 0 <= self.average <= 1:
            raise SessionError(f"--average {self.average:g}: it is a share of the steps, 0 to 1")
        for name in ("minutes", "rate"):
            if not getattr(self, name) > 0:
                raise SessionError(f"--{name} {getattr(self, name):g}: it has to be above 0")
        for name, least in (("batch", 1), ("threads", 1), ("workers", 0), ("backgrounds", 1), ("shards", 0)):
            if (value := getattr(self, name)) is not None and value < least:
                raise SessionError(f"--{name} {value}: {least} at least")
        _refuse_file(self.out)


@dataclass(frozen=True)
class KeypointTraining(Training):
    """Train the keypoint network on crops of synthetic people.

    Attributes:
        size: side of the crops in pixels, a multiple of 32.
        model: fp32 network of ours to begin with, such as a shipped one, where `out` has no run yet.
        smaller: share of the batches whose crops are smaller than `size`, as those of the first look at people and of
            people seen in part are. A network that saw one size for long reads no other.
        hard: share of the crops that are drawn by how wrong the network was on their people before.
        second: what the network's threads and the making of crops leave idle of the processors, a second process uses
            for a part of every batch, in runs of five minutes and more.
        echo: how often a GPU sees a crop at most, in the mean, each time turned, mirrored and lit anew: while the next
            are being made it would wait. 1: once, as a CPU does.
    """

    size: int = 128
    model: pathlib.Path | None = None
    smaller: float = 0.35
    hard: float = 0.0
    second: bool = True
    echo: int = 8

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.size % 32 or self.size < 64:
            raise SessionError(f"--size {self.size}: a multiple of 32, from 64 on")


@dataclass(frozen=True)
class PeopleTraining(Training):
    """Train the person detector on scenes of synthetic people.

    Attributes:
        workers: processes that make the images; if not given two, since a scene takes twice as long as what the
            network does with it, where a GPU trains one for every processor but one.
        model: detector of ours to begin with, such as the shipped one, where `out` has no run yet.
    """

    whole: ClassVar[bool] = True
    out: pathlib.Path = pathlib.Path("runs/people")
    minutes: float = 30.0
    batch: int = 32
    model: pathlib.Path | None = None


@dataclass(frozen=True)
class LabelTraining(Training):
    """Train the marker labelling network on synthetic marker clouds.

    Attributes:
        markerset: what the network sees most of: `pig39`, `cmu41`, or `all` (both, and random sets).
        clips: folder of marker trajectories, made where they are missing.
        shards: how many shards of 32 clips there shall be; the first four are held out from training.
    """

    out: pathlib.Path = pathlib.Path("runs/labels")
    clips: pathlib.Path = pathlib.Path("runs/labels/clips")
    shards: int = 96
    markerset: Literal["all", "pig39", "cmu41"] = "all"
    batch: int = 48
    rate: float = 3e-3
    decay: float = 0.3
    workers: int = 0


@dataclass(frozen=True)
class SolverTraining(Training):
    """Train the network that corrects bodies fitted to markers, on synthetic people.

    Attributes:
        clips: folder of markers and joints under generated motion, made where they are missing.
        shards: how many shards of 32 clips, and of as many of other people who follow the same motions, there shall be;
            the first is held out from training.
        workers: processes that make fits before the training begins.
    """

    out: pathlib.Path = pathlib.Path("runs/solver")
    clips: pathlib.Path = pathlib.Path("runs/solver/clips")
    shards: int = 24
    minutes: float = 40.0
    batch: int = 256
    rate: float = 2e-3
    decay: float = 0.4
    workers: int = 1


@dataclass(frozen=True)
class Evaluation:
    """Score a keypoint network on held-out synthetic crops, read as `muybridge run` reads those of static cameras.

    Attributes:
        model: the ONNX file; the shipped one by default.
        renders: folder of the render store, whose first four shards nobody trains on.
        all_shards: score all of the store, for one that nobody trains on: the more people, the less the figures owe to
            who they are.
        crops: how many crops, rounded up to batches of 64.
        seed: of the crops.
        faults: with what a camera does to a picture: blur, noise, compression and the rest.
        occlusion: with things and people in front, faces made unrecognisable, borders, clutter and people who tumble.
        embrace: with somebody right behind or before everyone, as in a hold; without, others stand beside a few.
        backdrop: everyone before a curtain, a screen or a bare wall.
        tinted: in coloured light.
        monochrome: by a camera without colours.
        plate: with the difference to the background plate, as good as a static camera's plate is.
        flip: every crop also mirrored.
        turn: crops of which the network is unsure also turned by quarters and, with `flip`, tilted to both sides.
    """

    model: pathlib.Path | None = None
    renders: pathlib.Path = pathlib.Path("runs/renders")
    all_shards: bool = False
    crops: int = 1024
    seed: int = 10_000
    faults: bool = True
    occlusion: bool = True
    embrace: bool = False
    backdrop: bool = False
    tinted: bool = False
    monochrome: bool = False
    plate: bool = True
    flip: bool = True
    turn: bool = True

    def __post_init__(self) -> None:
        if self.crops < 1:
            raise SessionError(f"--crops {self.crops}: 1 at least")
