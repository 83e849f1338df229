"""Faults in training are reported at once, and no progress is lost."""

import itertools
import os
import pathlib
import signal
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("onnx")
torch = pytest.importorskip("torch")
pytest.importorskip("kornia")

from muybridge.errors import ModelError, SessionError  # noqa: E402
from muybridge.train.engine import loop  # noqa: E402
from muybridge.train.engine.checkpoint import load_checkpoint  # noqa: E402
from muybridge.train.keypoints import train as keypoints  # noqa: E402
from muybridge.train.keypoints.evaluate import evaluate_onnx  # noqa: E402
from muybridge.train.keypoints.export import load_keypoint_checkpoint  # noqa: E402
from muybridge.train.keypoints.options import Evaluation, KeypointTraining  # noqa: E402
from muybridge.train.people import train as people  # noqa: E402
from muybridge.train.people.options import PeopleTraining  # noqa: E402
from muybridge.train.synthesis.rendering.store import load_renders  # noqa: E402

pytestmark = pytest.mark.usefixtures("few_held_out")


def _short(store, out, **changes):
    return KeypointTraining(
        renders=store, out=out, minutes=0.05, size=64, batch=8, backgrounds=8, threads=1, workers=0, **changes
    )


def test_diverged_training_keeps_the_last_checkpoint(store, tmp_path):
    before = keypoints.train(_short(store, tmp_path / "run")).read_bytes()
    with pytest.raises(SessionError, match="diverged after .* less than --rate 1e"):
        keypoints.train(_short(store, tmp_path / "run", rate=1e30))
    assert (tmp_path / "run" / "checkpoint.pt").read_bytes() == before


def test_interrupted_training_saves_a_checkpoint(store, tmp_path, monkeypatch):
    step, made = loop.TrainingRun._step, []

    def stopped(self, *args):
        if len(made) == 3:
            raise KeyboardInterrupt
        made.append(step(self, *args))
        return made[-1]

    monkeypatch.setattr(loop.TrainingRun, "_step", stopped)
    with pytest.raises(KeyboardInterrupt):
        keypoints.train(replace(_short(store, tmp_path / "run"), minutes=0.5, second=False))
    assert load_keypoint_checkpoint(tmp_path / "run" / "checkpoint.pt")["state"]["images"] == 24


@pytest.mark.slow
def test_equal_seeds_and_steps_give_equal_keypoint_networks(store, tmp_path):
    one, two = (load_keypoint_checkpoint(keypoints.train(_short(store, tmp_path / k, steps=2))) for k in "ab")
    assert one["state"]["step"] == 2
    assert all((one["net"][k] == two["net"][k]).all() for k in one["net"])


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"size": 32}, "--size 32: must be a multiple of 32, at least 64"), ({"size": 100}, "--size 100"),
        ({"minutes": 0.0}, "--minutes 0: must be above 0"), ({"rate": -1.0}, "--rate -1"),
        ({"batch": 0}, "--batch 0: must be at least 1"), ({"threads": 0}, "--threads 0"),
        ({"workers": -1}, "--workers -1"),
        ({"out": pathlib.Path(__file__) / "run"}, "is a file; name a folder"),
    ],
)  # fmt: skip
def test_invalid_options_are_refused(wrong, said):
    with pytest.raises(SessionError, match=said):
        KeypointTraining(**wrong)


def test_unusable_stores_are_refused(store, tmp_path):
    with pytest.raises(SessionError, match="the first 4 are held out"):
        keypoints.train(replace(_short(tmp_path / "none", tmp_path / "run"), shards=3))
    parts = tmp_path / "parts"
    parts.mkdir()
    for path in store.iterdir():
        if path.suffix == ".npy":
            (parts / path.name).symlink_to(path)
        elif path.suffix == ".npz":
            labels = dict(np.load(path))
            np.savez(parts / path.name, **(labels | {"cut_px": np.ones((len(labels["visible"]), 3))}))
    with pytest.raises(SessionError, match="only renders of parts of people"):
        people.train(PeopleTraining(renders=parts, out=tmp_path / "run", minutes=0.02, batch=4, backgrounds=8))
    path = sorted(parts.glob("*.npz"))[-1]
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(SessionError, match=f"{path.name}: a damaged shard"):
        keypoints.train(_short(parts, tmp_path / "run"))
    sorted(parts.glob("*.npy"))[-1].unlink()
    path.unlink()
    sorted(parts.glob("*.npy"))[-1].unlink()
    with pytest.raises(SessionError, match="without the pixels beside it"):
        load_renders(parts)


def test_checkpoint_of_another_network_is_refused(store, tmp_path):
    out = tmp_path / "run"
    people.train(PeopleTraining(renders=store, out=out, minutes=0.02, batch=4, backgrounds=8, workers=0))
    with pytest.raises(ModelError, match="it has a run of another network"):
        keypoints.train(_short(store, out))
    (out / "checkpoint.pt").write_bytes(b"nothing")
    with pytest.raises(SessionError, match="not a training checkpoint of muybridge, or a damaged one"):
        people.train(PeopleTraining(renders=store, out=out, minutes=0.02, batch=4, backgrounds=8, workers=0))


@pytest.mark.parametrize("content", [None, b"nothing"])
def test_files_other_than_networks_are_not_scored(store, tmp_path, content):
    path = tmp_path / "model.onnx"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ModelError, match="model.onnx: n"):
        evaluate_onnx(Evaluation(path, renders=store, crops=64))


class _Line(torch.nn.Module):
    """The smallest network that can be trained."""

    def __init__(self) -> None:
        super().__init__()
        self.config: dict[str, int] = {}
        self.slope = torch.nn.Parameter(torch.zeros(1))


def test_a_run_of_so_many_images_ends_there_however_often_it_was_stopped(tmp_path):
    rates = []

    def train_on():
        run = loop.TrainingRun(KeypointTraining(out=tmp_path, images=44, batch=8), _Line(), lambda net: {"score": 1.0})

        def loss_of(net, batch):
            rates.append(run.optimiser.parts[0].param_groups[0]["lr"])
            if len(rates) == 3:
                os.kill(os.getpid(), signal.SIGTERM)
            loss = ((net.slope - batch[0]) ** 2).mean()
            return loss, loss.detach()

        run.run(itertools.repeat((torch.ones(8, 1),)), loss_of)

    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt):
        train_on()
    assert signal.getsignal(signal.SIGTERM) is before
    assert load_checkpoint(tmp_path / "checkpoint.pt")["state"]["step"] == 2
    train_on()
    train_on()  # there is nothing left to do
    done = load_checkpoint(tmp_path / "checkpoint.pt")
    assert done["state"]["step"] == 6 and done["state"]["images"] == 48 and len(rates) == 3 + 4
    assert rates[3] == rates[2] and rates[4] > rates[3]  # the warm-up goes on


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"scenes": 2.0}, "--scenes 2: must be"), ({"images": 0}, "--images 0"),
        ({"images": 9, "steps": 9}, "give one of them"),
    ],
)  # fmt: skip
def test_invalid_options_of_images_are_refused(wrong, said):
    with pytest.raises(SessionError, match=said):
        PeopleTraining(**wrong)


def test_a_store_of_scenes_without_renders_is_named(store, tmp_path):
    options = _short(store, tmp_path / "run", scene_renders=(tmp_path / "nothing",))
    with pytest.raises(SessionError, match="nothing: no renders to train on"):
        keypoints.train(options)
