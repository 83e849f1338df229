"""The commands `synth`, `train` and `eval`. torch is imported when a command runs, not for its help."""

import shlex
import sys
from typing import Annotated, Literal

import tyro

from muybridge.train.characters.options import RiggerTraining, SkinningTraining
from muybridge.train.correction.options import SolverTraining
from muybridge.train.keypoints.options import Adaptation, Evaluation, KeypointTraining
from muybridge.train.labelling.options import LabelTraining
from muybridge.train.people.options import PeopleTraining
from muybridge.train.synthesis.options import Synthesis

_Network = Annotated[
    Annotated[KeypointTraining, tyro.conf.subcommand("keypoints")]
    | Annotated[PeopleTraining, tyro.conf.subcommand("people")]
    | Annotated[LabelTraining, tyro.conf.subcommand("labels")]
    | Annotated[SolverTraining, tyro.conf.subcommand("solver")]
    | Annotated[RiggerTraining, tyro.conf.subcommand("rigger")]
    | Annotated[SkinningTraining, tyro.conf.subcommand("skinning")]
    | Annotated[Adaptation, tyro.conf.subcommand("adapt")],
    tyro.conf.arg(name=""),
]

# What `--help` shows; `--help-all` shows every option.
COMMON_OPTIONS = {
    "train": (
        "renders", "scene_renders", "scenes", "shards", "out", "minutes", "images", "steps", "batch", "rate", "model",
        "footage", "clips", "markerset", "workers", "seed",
    )
}  # fmt: skip


def _command_line() -> str:
    return shlex.join(["muybridge", *sys.argv[1:]])


def synth(options: Annotated[Synthesis, tyro.conf.arg(name="")]) -> None:
    """Render synthetic people to train on: a store of seeded renders and a contact sheet."""
    from muybridge.train.engine.process_pool import affordable_processes
    from muybridge.train.synthesis.rendering.store import MEMORY, make_renders, shard_numbers

    if set(range(options.shards)) <= set(shard_numbers(options.out)):
        print(
            f"{options.out} already has {options.shards} shards, whatever options they were made with; choose another "
            "--out to make new ones"
        )
    processes = affordable_processes(MEMORY) if options.processes is None else options.processes
    make_renders(
        options.out, range(options.shards), options.seed, options.kinds, options.close_ups, processes, options.scenes
    )
    if options.sheet:
        from muybridge.train.images.contact_sheet import write_sheet

        print(f"contact sheet: {write_sheet(options.out)}")


def train(network: _Network) -> None:
    """Train a network on synthetic people, from renders to ONNX, on a CPU or a GPU; resumes an interrupted run."""
    if isinstance(network, KeypointTraining):
        _train_keypoints(network)
    elif isinstance(network, PeopleTraining):
        _train_people(network)
    elif isinstance(network, LabelTraining):
        _train_labels(network)
    elif isinstance(network, SolverTraining):
        _train_solver(network)
    elif isinstance(network, RiggerTraining):
        _train_rigger(network)
    elif isinstance(network, SkinningTraining):
        _train_skinning(network)
    else:
        from muybridge.train.keypoints.adapt_export import adapt

        print(adapt(network, _command_line()))


def _train_keypoints(options: KeypointTraining) -> None:
    from muybridge.train.images.dataset import background_pool
    from muybridge.train.keypoints import train as keypoints
    from muybridge.train.keypoints.export import publish_keypoints

    checkpoint = keypoints.train(options)
    path = options.out / "keypoints.onnx"
    batches = keypoints.held_out_batches(options.renders, background_pool(options), options.size, 24)
    publish_keypoints(checkpoint, path, batches, _command_line())
    print(f"wrote {path}; use it with `muybridge run SESSION` and its model options")


def _train_people(options: PeopleTraining) -> None:
    from muybridge.train.people import train as people
    from muybridge.train.people.export import publish_people

    path = options.out / "people.onnx"
    publish_people(people.train(options), path, _command_line())
    print(f"wrote {path}; use it with `muybridge run SESSION` and its model options")


def _train_labels(options: LabelTraining) -> None:
    from muybridge.train.labelling import train as labels
    from muybridge.train.labelling.export import publish_labels

    path = options.out / "labels.onnx"
    publish_labels(labels.train(options), path, options.clips, _command_line())
    print(f"wrote {path}; use it with `muybridge label FILE --model {path}`")


def _train_solver(options: SolverTraining) -> None:
    from muybridge.train.correction import train as solver
    from muybridge.train.correction.export import publish_solver

    path = options.out / "solver.onnx"
    publish_solver(solver.train(options), path, options.out / "fits", _command_line())
    print(f"wrote {path}; use it with `muybridge solve POINTS --network {path}`")


def _train_rigger(options: RiggerTraining) -> None:
    from muybridge.train.characters import train_joints as rigger
    from muybridge.train.characters.export_joints import publish_rigger

    path = options.out / "rigger.onnx"
    publish_rigger(rigger.train(options), path, options.out / "bodies", _command_line())
    print(f"wrote {path}")


def _train_skinning(options: SkinningTraining) -> None:
    from muybridge.train.characters import train_weights as skinning
    from muybridge.train.characters.export_weights import publish_skinning

    path = options.out / "skinning.onnx"
    publish_skinning(skinning.train(options), path, options.out / "examples", _command_line())
    print(f"wrote {path}")


def evaluate(
    options: Annotated[Evaluation, tyro.conf.arg(name="")],
    network: tyro.conf.Positional[Literal["keypoints"]] = "keypoints",
) -> None:
    """Score the keypoint network on held-out synthetic people: error, PCK, left-right flips, variance calibration.

    Args:
        options: what to score, and on which data.
        network: kind of network; only keypoint networks can be scored.
    """
    from muybridge.train.keypoints.evaluate import evaluate_onnx

    steps = {"background difference": options.plate, "mirrored crops": options.flip,
             "rotation of uncertain crops": options.turn}  # fmt: skip
    how = ", ".join(f"{'with' if on else 'without'} {step}" for step, on in steps.items())
    print(f"{options.crops} held-out crops, {how}")
    for name, value in evaluate_onnx(options).items():
        print(f"{name:<26} {value:.4g}")
