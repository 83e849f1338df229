"""Renders made during training."""

import json
import os
import pathlib
import signal
import subprocess
import sys
import time
from collections.abc import Callable

import pytest

torch = pytest.importorskip("torch")

from muybridge.errors import SessionError  # noqa: E402
from muybridge.models.keypoints.metadata import keypoint_card  # noqa: E402
from muybridge.train.images import dataset  # noqa: E402
from muybridge.train.keypoints import train as keypoints  # noqa: E402
from muybridge.train.keypoints.options import KeypointTraining  # noqa: E402
from muybridge.train.synthesis.rendering import worker as beside  # noqa: E402
from muybridge.train.synthesis.rendering.store import shard_numbers  # noqa: E402
from muybridge.train.synthesis.rendering.worker import PLAN, RenderWorker  # noqa: E402

pytestmark = pytest.mark.usefixtures("few_held_out")

# The process itself, with a renderer that copies another store's shards, the last one over and over.
_COPIER = """
import pathlib, shutil, sys, time
from muybridge.files import replacing
from muybridge.train.synthesis.rendering import worker as beside

def copies(folder, numbers, seed, processes):
    for number in numbers:
        if (folder / f"renders-{number:05d}.npz").exists():
            continue
        for suffix in (".npy", ".npz"):
            with replacing(folder / f"renders-{number:05d}{suffix}") as temporary:
                shutil.copy(pathlib.Path(sys.argv[1]) / f"renders-{min(number, 4):05d}{suffix}", temporary)
                time.sleep(float(sys.argv[2]))

beside.make_renders = copies
beside.main(pathlib.Path(sys.argv[3]), int(sys.argv[4]), int(sys.argv[5]))
"""


@pytest.fixture
def copier(store: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Shards come from `store`, one in 0.4 s."""
    monkeypatch.setattr(beside, "_command", lambda *what: [
        sys.executable, "-c", _COPIER, str(store), "0.2", *map(str, what)])  # fmt: skip


@pytest.mark.usefixtures("copier")
def test_a_training_without_renders_makes_them(tmp_path: pathlib.Path) -> None:
    renders = tmp_path / "renders"
    options = KeypointTraining(
        renders=renders, out=tmp_path / "run", shards=14, minutes=0.08, batch=4, size=64, backgrounds=8, workers=0
    )
    keypoints.train(options)
    # Training began with eight and ended before all were there, or with all: its successor makes the others.
    there = shard_numbers(renders)
    assert there[:8] == list(range(8))
    assert (renders / PLAN).exists() == (len(there) < 14)
    assert not list(renders.glob(".*.tmp*"))
    with RenderWorker(renders, 14, seed=0) as others:
        others.wait_for(14)
        if others._process is not None:
            assert others._process.wait(10) == 0
    assert shard_numbers(renders) == list(range(14)) and not (renders / PLAN).exists()
    with RenderWorker(renders, 20, seed=0) as none:  # what is whole is left as it is, however many are wanted
        assert not none.making


@pytest.mark.usefixtures("copier")
def test_renderer_that_has_made_everything_ends_without_an_error(tmp_path: pathlib.Path) -> None:
    with RenderWorker(tmp_path, 2, seed=0) as others:
        assert others._process is not None
        assert others._process.wait(60) == 0  # before its standard input is closed
        others.wait_for(2)
    assert [p.name for p in tmp_path.iterdir() if p.suffix not in (".npy", ".npz")] == []


@pytest.mark.usefixtures("copier")
def test_new_shards_are_used_as_they_appear(tmp_path: pathlib.Path) -> None:
    options = KeypointTraining(renders=tmp_path / "renders", out=tmp_path, workers=0, shards=30)
    counts: list[int] = []

    def make(renders, seed):
        counts.append(len(renders))
        return lambda: time.sleep(0.01)

    with RenderWorker(options.renders, options.shards, seed=0) as others:
        others.wait_for(6)
        stream = dataset.batches(options, make, 0)
        for _ in range(450):
            next(stream)
    assert len(counts) >= 3 and sorted(set(counts)) == counts


def test_existing_stores_are_not_extended(store: pathlib.Path) -> None:
    with RenderWorker(store, 60, seed=0) as none:
        none.wait_for(60)  # does not wait either
        assert not none.making and not (store / PLAN).exists()


def test_output_of_a_failed_renderer_is_quoted(tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(beside, "_command", lambda *_: [sys.executable, "-c", "raise OSError('no EGL anywhere')"])
    said = r"no EGL anywhere .*unfinished\.log"
    with RenderWorker(tmp_path, 60, seed=0) as others, pytest.raises(SessionError, match=said):
        others.wait_for(8)


def test_unreadable_plan_is_named(tmp_path: pathlib.Path) -> None:
    (tmp_path / PLAN).write_text("{}")
    with pytest.raises(SessionError, match=r"unfinished\.json: does not tell which renders are missing"):
        RenderWorker(tmp_path, 60, seed=0)


@pytest.mark.skipif(sys.platform == "win32", reason="kills a process group's leader")
@pytest.mark.parametrize("background", [False, True])
def test_rendering_ends_when_training_is_killed(
    store: pathlib.Path, tmp_path: pathlib.Path, gone: Callable[[int], bool], background: bool
) -> None:
    program = (
        # as a shell starts a background job
        f"import signal\nsignal.signal(signal.SIGINT, signal.{'SIG_IGN' if background else 'default_int_handler'})\n"
        "import pathlib, sys, time\nfrom muybridge.train.synthesis.rendering import worker as beside\n"
        f"beside._command = lambda *what: [sys.executable, '-c', {_COPIER!r}, {str(store)!r}, '0.2', *map(str, what)]\n"
        f"others = beside.RenderWorker(pathlib.Path({str(tmp_path)!r}), 60, 3)\nothers.wait_for(2)\n"
        "print(others._process.pid, flush=True)\ntime.sleep(60)\n"
    )
    training = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert training.stdout is not None
    lines = iter(training.stdout.readline, "")
    pid = next(int(line) for line in lines if line.strip().isdigit())
    os.kill(training.pid, signal.SIGKILL)
    training.wait()
    deadline = time.monotonic() + 20
    while not gone(pid) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert gone(pid) and not list(tmp_path.glob(".*.tmp*"))
    assert json.loads((tmp_path / PLAN).read_text()) == {"shards": 60, "seed": 3}
    assert 2 <= len(shard_numbers(tmp_path)) < 60


@pytest.mark.slow
def test_from_nothing_to_onnx(tmp_path: pathlib.Path) -> None:
    arguments = ["--renders", "renders", "--out", "run", "--minutes", "0.3", "--shards", "6", "--size", "64",
                 "--batch", "16", "--backgrounds", "16"]  # fmt: skip
    done = subprocess.run([sys.executable, "-m", "muybridge", "train", "keypoints", *arguments], cwd=tmp_path,
                          capture_output=True, text=True, timeout=900)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert len(shard_numbers(tmp_path / "renders")) == 6
    import onnxruntime

    session = onnxruntime.InferenceSession(str(tmp_path / "run/keypoints.onnx"), providers=["CPUExecutionProvider"])
    assert keypoint_card(session.get_modelmeta().custom_metadata_map, tmp_path / "run/keypoints.onnx").input_size == 64
