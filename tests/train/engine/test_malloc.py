"""Memory freed by a training step stays with the process."""

import subprocess
import sys

import pytest

from muybridge.train.engine import malloc as memory

# Pages that the system had to give anew, in rounds of 64 MiB that are written to and given back.
_ROUNDS = """
import ctypes, resource, sys
from muybridge.train.engine.malloc import keep_memory

library = ctypes.CDLL(None)
library.malloc.restype, library.malloc.argtypes = ctypes.c_void_p, [ctypes.c_size_t]
library.free.argtypes = [ctypes.c_void_p]
told = keep_memory() if sys.argv[1] == "kept" else True
for k in range(5):
    if k == 1:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    block = library.malloc(1 << 26)
    ctypes.memset(block, 1, 1 << 26)
    library.free(block)
print(told, resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def _pages(how: str) -> tuple[str, int]:
    run = subprocess.run([sys.executable, "-c", _ROUNDS, how], capture_output=True, text=True, check=True)
    told, pages = run.stdout.split()
    return told, int(pages)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="of glibc's allocator")
def test_freed_memory_is_reused():
    told, kept = _pages("kept")
    if told == "False":
        pytest.skip("this C library cannot be told to keep memory")
    _, anew = _pages("as it is")
    # The first round alone, before counting began, needs pages; as it is, every round does (fewer where they are huge).
    assert kept < 50
    assert anew > 4 * kept


def test_other_systems_are_not_changed(monkeypatch):
    monkeypatch.setattr(memory.sys, "platform", "darwin")
    assert memory.keep_memory() is False
    monkeypatch.setattr(memory.sys, "platform", "linux")
    monkeypatch.setattr(memory.ctypes, "CDLL", lambda name: object())  # a C library without it, such as musl
    assert memory.keep_memory() is False
