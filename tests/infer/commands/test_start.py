"""What a run loads before it decodes the first frame: counted in modules, since seconds depend on the machine."""

import json
import subprocess
import sys

import pytest

# What only later stages need, and what is slow to load of what they are made of.
LATER = {
    "llvmlite", "matplotlib", "numba", "pycolmap", "scipy.cluster", "scipy.linalg", "scipy.ndimage", "scipy.optimize",
    "scipy.signal", "scipy.sparse", "scipy.spatial", "scipy.special", "skimage.filters", "skimage.measure",
    "muybridge.infer.report.page", "muybridge.infer.viewer.data", "muybridge.infer.pipelines.marker_videos",
    "muybridge.motion.character.character", "muybridge.motion.contacts.find", "muybridge.motion.formats.registry",
}  # fmt: skip

_AT_THE_FIRST_FRAME = """
import json, sys
from muybridge.infer.commands import app
from muybridge.infer.pipelines import warm_up
from muybridge.infer.session import video

warm_up.CompiledAhead._prepare = lambda self: None  # its thread would load more, some time

def decoded(*_):
    print("loaded", json.dumps(sorted(sys.modules)), flush=True)
    raise KeyboardInterrupt

video._decode = decoded
sys.argv[1:] = ARGUMENTS
app.main()
"""


def loaded_by(code: str) -> set[str]:
    """The modules that a process prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    lines = [line for line in done.stdout.splitlines() if line.startswith("loaded ")]
    assert lines, done.stderr
    return set(json.loads(lines[0].removeprefix("loaded ")))


def test_the_first_frame_waits_for_no_module_of_later_stages(tmp_path):
    arguments = ["demo", "--out", str(tmp_path / "out"), "--quiet"]
    modules = loaded_by(_AT_THE_FIRST_FRAME.replace("ARGUMENTS", repr(arguments)))
    assert "muybridge.infer.detection.detect" in modules
    assert not modules & LATER
    assert len(modules) < 900


@pytest.mark.parametrize("arguments", [["run", "missing"], ["run", "--help"]])
def test_a_refusal_loads_even_less(arguments, tmp_path):
    code = f"""
import atexit, json, os, sys
os.chdir({str(tmp_path)!r})
from muybridge.infer.commands import app
atexit.register(lambda: print("loaded", json.dumps(sorted(sys.modules))))
app.main({arguments!r})
"""
    assert not loaded_by(code) & LATER


def test_the_thread_loads_what_later_stages_need():
    code = """
import json, sys
from muybridge.infer.pipelines import warm_up
from muybridge.infer.runtime.progress import Progress

warm_up.is_compiled = lambda kernel: True
with warm_up.CompiledAhead() as ahead:
    ahead.wait(Progress(quiet=True))
print("loaded", json.dumps(sorted(sys.modules)))
"""
    assert {"pycolmap", "scipy.optimize", "scipy.spatial", "muybridge.infer.report.page"} <= loaded_by(code)
