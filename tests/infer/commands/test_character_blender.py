"""What Blender shows of a GLB that `muybridge character` wrote."""

import os
import subprocess
import sys
from importlib.util import find_spec

import numpy as np
import pytest
from scipy.spatial import cKDTree

from muybridge.infer.commands.motion.character import character
from muybridge.motion.character import read_character
from tests.geometry.roles.bodies import human
from tests.infer.commands.test_character import obj
from tests.infer.commands.test_retarget import body_file
from tests.motion.character.rigging.figures import person
from tests.paths import REPOSITORY

BLENDER = os.environ.get("MUYBRIDGE_BLENDER_PYTHON") or (sys.executable if find_spec("bpy") else None)
SCRIPT = REPOSITORY / "tests" / "motion" / "character" / "meshes" / "blender_vertices.py"
FRAMES = 10


@pytest.mark.slow
@pytest.mark.parametrize("rig", ["muybridge", "mixamo"])
def test_blender_shows_the_vertices_where_they_are(tmp_path, rig):
    if not BLENDER:
        pytest.skip("Blender's Python module is not here: pip install bpy, or set MUYBRIDGE_BLENDER_PYTHON")
    hero, out = obj(tmp_path / "hero.obj", *person(40.0)[:2]), tmp_path / "hero.glb"
    take = body_file(tmp_path / "walk.bvh", human(np.random.default_rng(0)))
    # Blender's scenes have 24 frames per second, at which the importer places the keys.
    assert character(hero, motion=(take,), out=out, rig=rig, fps=24.0) == 0
    done = subprocess.run([BLENDER, SCRIPT, out, tmp_path / "seen.npz", str(FRAMES)], capture_output=True, text=True,
                          timeout=300)  # fmt: skip
    assert done.returncode == 0, done.stderr
    seen = np.load(tmp_path / "seen.npz")["vertices"]
    back = read_character(out, "walk")
    posed = np.concatenate(back.pose(back.motion), axis=1)[:FRAMES]
    assert len(seen) == len(posed) == FRAMES and np.abs(posed[-1] - posed[0]).max() > 0.02
    # Blender may join or reorder vertices, but a vertex keeps its neighbours, so places are compared as sets.
    away = [max(cKDTree(a).query(b)[0].max(), cKDTree(b).query(a)[0].max()) for a, b in zip(seen, posed, strict=True)]
    assert max(away) < 1e-4
