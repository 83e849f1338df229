"""Options of the keypoint network's training, adaptation and evaluation. No torch here, so that help works without."""

import pathlib
from dataclasses import dataclass

from muybridge.errors import SessionError
from muybridge.train.engine.options import ImageTraining


@dataclass(frozen=True)
class KeypointTraining(ImageTraining):
    """Train the keypoint network on crops of synthetic people.

    Attributes:
        size: side of the crops in pixels, a multiple of 32.
        model: fp32 muybridge network to start from, such as a shipped one, if `out` has no run yet.
        attention: blocks of self-attention of the network; added to the one to start from if it has fewer.
        smaller: share of batches whose crops are smaller than `size`, like those of the first pass over a video and of
            partly visible people. A network trained at one size for long fails at others.
        hard: share of the crops drawn in proportion to the network's previous loss on their people.
        hidden: weight of the loss of hidden landmarks, whose place is guessed, relative to that of visible ones.
        second: let a second process compute part of each batch on processor time that the network's threads and the
            making of crops leave idle, in runs of five minutes and more.
        echo: with a GPU, the mean number of times a crop is used at most, each time with new geometric and colour
            augmentation, while the next crops are being made. 1: use each crop once, as on a CPU.
    """

    size: int = 128
    model: pathlib.Path | None = None
    attention: int = 0
    smaller: float = 0.35
    hard: float = 0.0
    hidden: float = 0.5
    second: bool = True
    echo: int = 8

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.size % 32 or self.size < 64:
            raise SessionError(f"--size {self.size}: must be a multiple of 32, at least 64")
        if self.attention < 0:
            raise SessionError(f"--attention {self.attention}: must be 0 blocks or more")


@dataclass(frozen=True)
class Adaptation:
    """How a keypoint network is adapted to unlabelled footage.

    Attributes:
        footage: crops with multi-view pseudo-labels, written by `muybridge adapt`.
        out: folder of the finished ONNX files.
        model: fp32 network to start from; default the shipped one.
        minutes: wall-clock time.
        steps: number of steps, in place of `minutes`.
        batch: images per step.
        rate: peak learning rate; it rises over the first steps and falls over the second half of the time.
        threads: torch threads; default all processors.
        seed: random seed; results still vary where the number of steps depends on the time.
    """

    footage: pathlib.Path
    out: pathlib.Path
    model: pathlib.Path | None = None
    minutes: float = 2.0
    steps: int | None = None
    batch: int = 32
    rate: float = 3e-4
    threads: int | None = None
    seed: int = 0


@dataclass(frozen=True)
class Evaluation:
    """Score a keypoint network on held-out synthetic crops, processed as `muybridge run` does with static cameras.

    Attributes:
        model: the ONNX file; the shipped one by default.
        renders: folder of the render store, whose first four shards are never trained on.
        all_shards: score on the whole store, for one that was never trained on. More people make the figures depend
            less on who they are.
        crops: number of crops.
        seed: random seed of the crops.
        faults: add camera faults: blur, noise, compression and others.
        occlusion: add objects and people in front, unrecognisable faces, image borders, clutter and tumbling people.
        embrace: put somebody right behind or in front of everyone, as in a hold; otherwise only a few have others
            beside them.
        backdrop: put everyone in front of a curtain, a screen or a bare wall.
        tinted: use coloured light.
        monochrome: use cameras without colour.
        plate: give the difference to the background model, as good as a static camera's.
        flip: average with the mirrored crop.
        turn: rotate uncertain crops by quarter turns and, with `flip`, tilt them to both sides.
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
            raise SessionError(f"--crops {self.crops}: must be at least 1")
