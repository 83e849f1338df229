"""Loops are compiled while a fresh installation's first run looks at its videos."""

import os
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest

from muybridge.geometry.numerics._numba import is_compiled
from muybridge.infer.pipelines import warm_up as compile_ahead
from muybridge.infer.pipelines.warm_up import CompiledAhead
from muybridge.infer.runtime.progress import Progress


def loop(folder):
    return SimpleNamespace(__module__="a.b.kernel", __name__="solve", stats=SimpleNamespace(cache_path=folder))


@pytest.fixture
def slow_process(monkeypatch):
    """Those processes that were started to compile, which sleep instead."""
    started = []
    sleeping = [sys.executable, "-c", "import time; time.sleep(60)"]
    popen = subprocess.Popen
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: started.append(popen(sleeping)) or started[-1])
    return started


def started(ahead):
    """Both processes, which a thread starts."""
    while len(ahead.processes) < 2:
        time.sleep(0.01)
    return ahead.processes


def test_cached_kernels_are_compiled(tmp_path):
    assert not is_compiled(loop(str(tmp_path)))
    (tmp_path / "kernel.solve_one-12.py311.nbi").touch()
    (tmp_path / "other.solve-12.py311.nbi").touch()
    assert not is_compiled(loop(str(tmp_path)))
    (tmp_path / "kernel.solve-12.py311.nbi").touch()
    assert is_compiled(loop(str(tmp_path)))
    # Where nothing is kept, and where numba is turned off.
    assert is_compiled(loop(None)) and is_compiled(is_compiled)


def test_nothing_is_started_where_all_is_compiled(monkeypatch, slow_process):
    monkeypatch.setattr(compile_ahead, "is_compiled", lambda loop: True)
    with CompiledAhead() as ahead, Progress(quiet=True) as progress:
        ahead.wait(progress)
    assert not ahead.processes and not slow_process


def test_nothing_is_started_where_no_interpreter_is(monkeypatch, slow_process):
    monkeypatch.setattr(compile_ahead, "is_compiled", lambda loop: False)
    for name, value in (("frozen", True), ("executable", "")):
        with monkeypatch.context() as context, Progress(quiet=True) as progress:
            context.setattr(sys, name, value, raising=False)
            with CompiledAhead() as ahead:
                ahead.wait(progress)
    monkeypatch.setattr(subprocess, "Popen", lambda *_, **__: (_ for _ in ()).throw(OSError("no memory")))
    with CompiledAhead() as ahead, Progress(quiet=True) as progress:
        ahead.wait(progress)
    assert not ahead.processes and not slow_process


def test_the_process_ends_with_its_context(monkeypatch, slow_process):
    monkeypatch.setattr(compile_ahead, "is_compiled", lambda loop: False)
    with pytest.raises(ZeroDivisionError), CompiledAhead() as ahead:
        started(ahead)
        assert all(process.poll() is None for process in ahead.processes)
        raise ZeroDivisionError
    assert len(slow_process) == 2 and all(process.poll() is not None for process in slow_process)
    with CompiledAhead() as ahead, Progress(quiet=True) as progress:
        for process in started(ahead):
            process.terminate()
        ahead.wait(progress)  # one that failed is no error


@pytest.mark.slow
def test_a_run_then_compiles_nothing_more(short_demo, tmp_path):
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    subprocess.run([sys.executable, "-m", "muybridge.infer.pipelines.warm_up"], env=environment, check=True)
    compiled = sorted(p.name for p in (tmp_path / "cache").rglob("*.nbc"))
    assert all(name.endswith(".1.nbc") for name in compiled)  # each for one kind of arguments
    run = [sys.executable, "-m", "muybridge", "run", str(short_demo), "--out", str(tmp_path / "out"), "--quiet"]
    subprocess.run(run, env=environment, check=True)
    assert compiled and sorted(p.name for p in (tmp_path / "cache").rglob("*.nbc")) == compiled
