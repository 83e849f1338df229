"""Damaged files: each reader gets a thousand; each must say clearly what is wrong, or read something sound."""

import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from muybridge.errors import FormatError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.geometry.numerics.rotations import exp_so3, quat_from_matrix
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.formats.fbx.read import read_fbx
from muybridge.motion.formats.fbx.write import write_fbx
from muybridge.motion.formats.gltf.read import read_gltf
from muybridge.motion.formats.gltf.write import write_glb
from muybridge.motion.formats.points.c3d import Analog, C3DTake, Event, read_c3d_take, write_c3d
from muybridge.motion.formats.points.csv import read_csv, write_csv
from muybridge.motion.formats.points.npz import read_npz, write_npz
from muybridge.motion.formats.points.trc import read_trc, write_trc
from muybridge.motion.formats.skeletal.amc import read_amc, write_amc
from muybridge.motion.formats.skeletal.bvh import read_bvh, write_bvh
from muybridge.motion.formats.skeletal.mot import read_mot, write_mot

MUTATIONS = 1000
_SECONDS = 3.0


def make_points() -> Points3D:
    rng = np.random.default_rng(0)
    xyz = rng.normal(0, 1, (4, 3, 3))
    xyz[1, 1] = np.nan
    none = (0, 4, 3)
    names = LandmarkSet("c3d", ("LASI", "RASI", "SACR"), ())
    return Points3D(names, xyz, np.full((4, 3, 3, 3), np.nan), np.empty(none), np.empty(none, bool), 100.0)


def make_motion() -> Motion:
    rng = np.random.default_rng(1)
    parents = (-1, 0, 1, 0)
    skeleton = Skeleton(
        ("hips", "spine", "head", "leg"), parents,
        np.array([[0, 0, 0], [0, 0, 0.2], [0, 0, 0.3], [0.1, 0, 0]]),
        np.array([[np.nan] * 3, [np.nan] * 3, [0, 0, 0.2], [0, 0, -0.8]]),
        (2,) * 4, np.full((4, 3), -np.inf), np.full((4, 3), np.inf),
    )  # fmt: skip
    return Motion(skeleton, 50.0, rng.normal(0, 1, (3, 3)), quat_from_matrix(exp_so3(rng.normal(0, 1, (3, 4, 3)))))


def mutated(data: bytes, rng: np.random.Generator, text: bool) -> bytes:
    """One to four of: other bytes, a piece cut out, doubled or swapped, the end cut off, a number made odd."""
    out = bytearray(data)
    odd = [b"nan", b"inf", b"-1", b"1e999", b"99999999999999999999", b"", b"x", b"0", b"\xff\xfe", b"{", b"}", b"\0"]
    for _ in range(rng.integers(1, 5)):
        if not out:
            break
        at = int(rng.integers(len(out)))
        size = int(rng.integers(1, 1 + min(60, len(out) - at)))
        kind = int(rng.integers(7))
        if kind == 0:
            out[at] = int(rng.integers(256))
        elif kind == 1:
            del out[at : at + size]
        elif kind == 2:
            out[at:at] = out[at : at + size]
        elif kind == 3:
            del out[at:]
        elif kind == 4 and text:
            word = odd[int(rng.integers(len(odd)))]
            end = at + next((k for k, c in enumerate(out[at:]) if chr(c).isspace()), 1)
            out[at:end] = word
        elif kind == 4:
            out[at] = [0, 1, 127, 128, 255][int(rng.integers(5))]
        elif kind == 5:
            other = int(rng.integers(len(out)))
            out[at], out[other] = out[other], out[at]
        else:
            out[at] ^= 1 << int(rng.integers(8))
    return bytes(out)


def check_points(points: Points3D) -> None:
    xyz = points.points_world
    assert xyz.ndim == 3 and xyz.shape[1:] == (len(points.landmarks), 3) and 0 < points.fps < np.inf
    assert not np.isinf(xyz).any() and (np.isnan(xyz).any(-1) == np.isnan(xyz).all(-1)).all()
    assert points.covariance_world.shape == (*xyz.shape, 3)


def check_motion(motion: Motion) -> None:
    assert np.isfinite(motion.root_positions_world).all() and np.isfinite(motion.skeleton.offsets).all()
    np.testing.assert_allclose(np.linalg.norm(motion.quat_wxyz, axis=-1), 1, atol=1e-6)
    assert 0 < motion.fps < np.inf and np.isfinite(motion.joint_positions_world()).all()


def check_take(take: C3DTake) -> None:
    check_points(take.points)
    assert all(np.isfinite(e.time) for e in take.events)


def check_table(table: object) -> None:
    assert np.isfinite(table.values).all() and len(table.names) == table.values.shape[1]


def take_of_all() -> C3DTake:
    analog = Analog(("Fz",), ("N",), 200.0, np.arange(8.0)[:, None])
    return C3DTake(make_points(), 5, (Event("Foot Strike", 0.1, "Left"),), analog)


CASES: dict[str, tuple[Callable, Callable, Callable, str]] = {
    "bvh": (lambda p: write_bvh(p, make_motion()), read_bvh, check_motion, ".bvh"),
    "amc": (lambda p: write_amc(p, make_motion()), read_amc, check_motion, ".amc"),
    "asf": (lambda p: write_amc(p.with_suffix(".amc"), make_motion()), lambda p: read_amc(p.with_name("good.amc"), p),
            check_motion, ".asf"),
    "glb": (lambda p: write_glb(p, make_motion()), read_gltf, check_motion, ".glb"),
    "fbx": (lambda p: write_fbx(p, make_motion()), lambda p: read_fbx(p)[0], check_motion, ".fbx"),
    "mot": (lambda p: write_mot(p, make_motion()), read_mot, check_table, ".mot"),
    "c3d": (lambda p: write_c3d(p, take_of_all()), read_c3d_take, check_take, ".c3d"),
    "trc": (lambda p: write_trc(p, make_points()), read_trc, check_points, ".trc"),
    "csv": (lambda p: write_csv(p, make_points()), read_csv, check_points, ".csv"),
    "npz": (lambda p: write_npz(p, make_points()), read_npz, check_points, ".npz"),
}  # fmt: skip


def fuzz(folder: Path, name: str, write: Callable, read: Callable, check: Callable, suffix: str) -> tuple[int, int]:
    """How many damaged files were read, and how many refused."""
    good = folder / f"good{suffix}"
    write(good)
    check(read(good))
    data = good.read_bytes()
    rng = np.random.default_rng(sum(map(ord, name)))
    bad = folder / f"bad{suffix}"
    if suffix == ".amc":
        (folder / "bad.asf").write_bytes((folder / "good.asf").read_bytes())
    fine = refused = 0
    for k in range(MUTATIONS):
        damaged = mutated(data, rng, suffix not in (".glb", ".fbx", ".c3d", ".npz", ".parquet"))
        bad.write_bytes(damaged)
        start = time.process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                check(read(bad))
            fine += 1
        except FormatError as error:
            refused += 1
            assert str(folder) in str(error) and "\n" not in str(error) and len(str(error)) < 2000, (k, error)
        except Exception as error:
            raise AssertionError(f"mutation {k} of {name}: {type(error).__name__}: {error}") from error
        assert time.process_time() - start < _SECONDS, f"mutation {k} of {name} took too long"
    return fine, refused


@pytest.mark.parametrize("name", CASES)
def test_a_thousand_damaged_files(tmp_path, name):
    fine, refused = fuzz(tmp_path, name, *CASES[name])
    assert fine + refused == MUTATIONS and refused > 100, "damage must show"


def test_a_thousand_damaged_parquet_files(tmp_path):
    pytest.importorskip("pyarrow", reason="pyarrow (the extra parquet) is not installed")
    from muybridge.motion.formats.points.parquet import read_parquet, write_parquet

    fine, refused = fuzz(
        tmp_path, "parquet", lambda p: write_parquet(p, make_points()), read_parquet, check_points, ".parquet"
    )
    assert fine + refused == MUTATIONS and refused > 100
