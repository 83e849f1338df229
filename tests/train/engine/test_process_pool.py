import importlib
import os
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip("torch")

from muybridge.errors import SessionError  # noqa: E402
from muybridge.train.engine import loop  # noqa: E402
from muybridge.train.engine import process_pool as processes
from muybridge.train.engine.process_pool import map_in_processes  # noqa: E402
from muybridge.train.keypoints.options import KeypointTraining  # noqa: E402
from muybridge.train.people.options import PeopleTraining  # noqa: E402
from muybridge.train.synthesis.rendering.store import make_renders  # noqa: E402

# Where the processes find it too.
STUDIOS = """
import os, signal, time
from dataclasses import dataclass
from pathlib import Path
from muybridge.errors import SessionError
from muybridge.train.engine.process_pool import exclusive

@dataclass
class Quick:
    folder: Path

    def make(self, number):
        time.sleep(0.2)
        (self.folder / str(number)).write_text(str(os.getpid()))
        return "nothing"

class Failing(Quick):
    def make(self, number):
        if number == 2:
            raise SessionError("shard 2 fails")
        return super().make(number)

class Slow(Quick):
    def make(self, number):
        super().make(number)
        time.sleep(60)

class Alone(Quick):
    def make(self, number):
        with exclusive("test"):
            with open(self.folder / "busy", "x"):  # nobody else's
                super().make(number)
            (self.folder / "busy").unlink()

class Dying(Quick):
    how = signal.SIGKILL

    def make(self, number):
        if number == 2:
            os.kill(os.getpid(), self.how)
        return super().make(number)

class Crashing(Dying):
    how = signal.SIGSEGV

    def make(self, number):
        if (self.folder / "crashed").exists():
            return Quick.make(self, number)
        if number == 2:
            (self.folder / "crashed").touch()
        return super().make(number)
"""


@pytest.fixture
def studios(tmp_path, monkeypatch):
    (tmp_path / "render_studios.py").write_text(STUDIOS)
    monkeypatch.syspath_prepend(tmp_path)
    return importlib.import_module("render_studios")


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "store").mkdir()
    return tmp_path / "store"


def test_several_processes_handle_every_item_once(studios, folder):
    assert list(map_in_processes(studios.Quick(folder).make, range(8), 2)) == ["nothing"] * 8

    makers = {path.read_text() for path in folder.iterdir()}
    assert sorted(int(path.name) for path in folder.iterdir()) == list(range(8))
    assert len(makers) == 2 and str(os.getpid()) not in makers


def test_exclusive_blocks_do_not_overlap(studios, folder):
    assert list(map_in_processes(studios.Alone(folder).make, range(6), 2)) == [None] * 6


def test_errors_in_a_process_are_reported(studios, folder):
    with pytest.raises(SessionError, match="shard 2 fails"):
        list(map_in_processes(studios.Failing(folder).make, range(4), 2))
    made = map_in_processes(studios.Dying(folder).make, range(6), 2)
    with pytest.raises(
        SessionError,
        match="one of 1 processes was terminated, perhaps because memory.*Finished results are kept",
    ):
        list(made)
    assert {int(path.name) for path in folder.iterdir()} >= {0, 1}
    with pytest.raises(SessionError, match="at least one"):
        make_renders(folder, range(4), 0, processes=0)


def test_other_processes_continue_after_a_crash(studios, folder, capsys):
    assert list(map_in_processes(studios.Crashing(folder).make, range(6), 2)) == ["nothing"] * 6
    assert "one of 2 processes was terminated (Segmentation fault); continuing with 1" in capsys.readouterr().err
    assert {path.name for path in folder.iterdir()} == {"crashed", *map(str, range(6))}


# No `if __name__ == "__main__"`, as in a user's script.
WAITING = """
import pathlib, signal, sys
from render_studios import Slow
signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell's background jobs ignore
from muybridge.train.engine.process_pool import map_in_processes
list(map_in_processes(Slow(pathlib.Path(sys.argv[1])).make, range(4), 2))
"""


@pytest.mark.parametrize(
    ("how", "to"), [(signal.SIGKILL, os.kill), (signal.SIGINT, os.kill), (signal.SIGINT, os.killpg)]
)
def test_processes_end_with_their_parent(tmp_path, studios, folder, gone, how, to):
    script = tmp_path / "waiting.py"
    script.write_text(WAITING)
    with subprocess.Popen(
        [sys.executable, str(script), str(folder)], start_new_session=True, stderr=subprocess.DEVNULL
    ) as parent:
        deadline = time.monotonic() + 60
        while len(list(folder.iterdir())) < 2:
            assert time.monotonic() < deadline and parent.poll() is None
            time.sleep(0.05)
        to(parent.pid, how)  # a terminal's interrupt goes to the whole group
        parent.wait(20)
    makers = [int(path.read_text()) for path in folder.iterdir()]
    while not all(gone(pid) for pid in makers):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert len(makers) == 2  # no other shard was begun


def test_processes_use_at_most_half_of_the_memory(monkeypatch):
    monkeypatch.setattr(processes, "processors", lambda: list(range(16)))
    monkeypatch.setattr(processes.os, "sysconf", lambda name: {"SC_PHYS_PAGES": 4_000_000, "SC_PAGE_SIZE": 4096}[name])
    assert (
        processes.affordable_processes(1e9) == 8
        and processes.affordable_processes(1e8) == 16
        and processes.affordable_processes(1e11) == 1
    )


def test_all_processors_but_one_make_images_for_a_gpu(monkeypatch):
    monkeypatch.setattr(loop, "processors", lambda: list(range(16)))
    assert loop.worker_count(KeypointTraining()) == 1 and loop.worker_count(PeopleTraining(), on_cpu=2) == 2
    monkeypatch.setattr(loop.torch.cuda, "is_available", lambda: True)
    assert loop.worker_count(KeypointTraining()) == 15 and loop.worker_count(KeypointTraining(workers=3)) == 3
