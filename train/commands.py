"""The commands `synth`, `train` and `eval`. torch is imported when a command runs, not for its help."""

import shlex
import sys
from typing import Annotated, Literal

import tyro

from muybridge.train.options import (
    Adaptation,
    Evaluation,
    KeypointTraining,
    LabelTraining,
    PeopleTraining,
    SolverTraining,
    Synthesis,
)

_Network = Annotated[
    Annotated[KeypointTraining, tyro.conf.subcommand("keypoints")]
    | Annotated[PeopleTraining, tyro.conf.subcommand("people")]
    | Annotated[LabelTraining, tyro.conf.subcommand("labels")]
    | Annotated[SolverTraining, tyro.conf.subcommand("solver")]
    | Annotated[Adaptation, tyro.conf.subcommand("adapt")],
    tyro.conf.arg(name=""),
]


def _command_line() -> str:
    return shlex.join(["muybridge", *sys.argv[1:]])


def synth(options: Annotated[Synthesis, tyro.conf.arg(name="")]) -> None:
    """Make synthetic people to train on: a store of seeded renders and a contact sheet."""
    from muybridge.train.engine.process_pool import affordable
    from muybridge.train.synthesis.rendering.store import MEMORY, make_renders, shard_numbers

    if set(range(options.shards)) <= set(shard_numbers(options.out)):
        print(f"{options.out} has these {options.shards} shards already, however they were made; --out makes others")
    processes = affordable(MEMORY) if options.processes is None else options.processes
    make_renders(options.out, range(options.shards), options.seed, options.kinds, options.close_ups, processes)
    if options.sheet:
        from muybridge.train.images.contact_sheet import write_sheet

        print(f"contact sheet: {write_sheet(options.out)}")


def train(network: _Network) -> None:
    """Train a network on synthetic people, from renders to ONNX, on a CPU or a GPU; resumes a killed run."""
    if isinstance(network, Adaptation):
        from muybridge.train.keypoints.adapt_export import adapt

        print(adapt(network, _command_line()))
        return
    if isinstance(network, LabelTraining):
        from muybridge.train.labelling import train as labels
        from muybridge.train.labelling.export import publish_labels

        path = network.out / "labels.onnx"
        publish_labels(labels.train(network), path, network.clips, _command_line())
        print(f"wrote {path}; use it with `muybridge label FILE --model {path}`")
        return
    if isinstance(network, SolverTraining):
        from muybridge.train.correction import train as solver
        from muybridge.train.correction.export import publish_solver

        path = network.out / "solver.onnx"
        publish_solver(solver.train(network), path, network.out / "fits", _command_line())
        print(f"wrote {path}; use it with `muybridge solve POINTS --network {path}`")
        return
    if isinstance(network, PeopleTraining):
        from muybridge.train.keypoints.export import publish_people
        from muybridge.train.people import train as people

        path = network.out / "people.onnx"
        publish_people(people.train(network), path, _command_line())
    else:
        from muybridge.train.engine import loop
        from muybridge.train.keypoints import train as keypoints
        from muybridge.train.keypoints.export import publish_keypoints

        checkpoint = keypoints.train(network)
        path = network.out / "keypoints.onnx"
        pool = loop.background_pool(network)
        publish_keypoints(
            checkpoint, path, keypoints.held_out_batches(network.renders, pool, network.size, 24), _command_line()
        )
    print(f"wrote {path}; use it with `muybridge run SESSION` and its model options")


def evaluate(
    options: Annotated[Evaluation, tyro.conf.arg(name="")],
    network: tyro.conf.Positional[Literal["keypoints"]] = "keypoints",
) -> None:
    """Score the keypoint network on held-out synthetic people: error, PCK, left-right swaps, sigma.

    Args:
        options: what is scored, on what.
        network: the kind of network; the only one that is scored here.
    """
    from muybridge.train.keypoints.evaluate import evaluate_onnx

    ways = {"the background plate": options.plate, "each crop mirrored": options.flip,
            "unsure ones turned": options.turn}  # fmt: skip
    how = ", ".join(f"{'with' if on else 'without'} {way}" for way, on in ways.items())
    print(f"{options.crops} held-out crops, {how}")
    for name, value in evaluate_onnx(options).items():
        print(f"{name:<26} {value:.4g}")
