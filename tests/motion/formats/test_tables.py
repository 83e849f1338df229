"""Points as CSV, Parquet and NPZ: round trips, other programs' ways of writing them, malformed files."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from muybridge.errors import FormatError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.motion.formats.points.csv import read_csv, write_csv
from muybridge.motion.formats.points.npz import read_npz, write_npz
from tests.paths import DATA


def make_points(frames: int = 5, seed: int = 0, fps: float = 60.0) -> Points3D:
    rng = np.random.default_rng(seed)
    xyz = rng.normal(0, 2, (frames, len(BODY23), 3))
    xyz[rng.random(xyz.shape[:2]) < 0.3] = np.nan
    covariance = np.where(np.isfinite(xyz[..., None]), np.eye(3) * 1e-4, np.nan)
    none = (0, *xyz.shape[:2])
    return Points3D(BODY23, xyz, covariance, np.empty(none), np.empty(none, bool), fps)


@settings(max_examples=10, deadline=None)
@given(
    seed=st.integers(0, 999), frames=st.integers(2, 9), fps=st.sampled_from([24.0, 29.97, 59.94, 60.0, 120.0, 1000.0])
)
def test_round_trips(tmp_path_factory, seed, frames, fps):
    points = make_points(frames, seed, fps)
    folder = tmp_path_factory.mktemp("tables")
    write_csv(folder / "p.csv", points)
    write_npz(folder / "p.npz", points)
    back = [(read_csv(folder / "p.csv"), 1e-6), (read_npz(folder / "p.npz"), 1e-15)]
    for other, tolerance in back:
        assert other.landmarks == BODY23 and other.fps == pytest.approx(fps, rel=1e-5)
        np.testing.assert_allclose(other.points_world, points.points_world, atol=tolerance)
    np.testing.assert_array_equal(back[1][0].covariance_world, points.covariance_world)
    assert sorted(p.name for p in folder.iterdir()) == ["p.csv", "p.npz"]


def test_parquet_round_trip(tmp_path):
    pyarrow = pytest.importorskip("pyarrow.parquet", reason="pyarrow (the extra parquet) is not installed")
    from muybridge.motion.formats.points.parquet import read_parquet, write_parquet

    points = make_points(fps=29.97)
    write_parquet(tmp_path / "p.parquet", points)
    back = read_parquet(tmp_path / "p.parquet")
    assert back.landmarks == BODY23 and back.fps == 29.97
    np.testing.assert_array_equal(back.points_world, points.points_world)
    assert read_parquet(tmp_path / "p.parquet", fps=50).fps == 50
    table = pyarrow.read_table(tmp_path / "p.parquet")
    assert table.column_names[:3] == ["frame", "time", "nose_x"] and table.column("nose_x").null_count > 0
    with pytest.raises(FormatError, match="bad.parquet: damaged, or not a Parquet file"):
        (tmp_path / "bad.parquet").write_bytes(b"PAR1 no PAR1")
        read_parquet(tmp_path / "bad.parquet")


def test_one_frame_needs_its_rate_said(tmp_path):
    write_csv(tmp_path / "p.csv", make_points(1))
    with pytest.raises(FormatError, match="pass `fps`"):
        read_csv(tmp_path / "p.csv")
    assert len(read_csv(tmp_path / "p.csv", fps=60).points_world) == 1


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("time,LASI_x,LASI_y,LASI_z\n0,1,2,3\n0.5,4,,6\n", "m"),
        ("Time (s);LASI.X;LASI.Y;LASI.Z\n0;1,0;2;3\n0,5;4;;6\n", "m"),
        ("frame\ttime\tLASI:x\tLASI:y\tLASI:z\t\n1\t0\t1\t2\t3\t\n2\t0.5\t4\tNaN\t6\t\n", "m"),
        ("# a comment\nt,LASI X (mm),LASI Y (mm),LASI Z (mm)\n0,1,2,3\n0.5,4,nan,6\n", "mm"),
        ("time,LASIx_x,lasiX,lasiY,lasiZ\n0,7,1,2,3\n0.5,8,4,-,6\n", "m"),
        ("frame,time,name,x,y,z\n1,0,LASI,1,2,3\n2,0.5,LASI,4,,6\n", "m"),
        ("\ufefftime,LASI_x_mm,LASI_y_mm,LASI_z_mm\r\n0,1,2,3\r\n0.5,4,,6\r\n", "mm"),
    ],
)
def test_ways_of_writing_tables(tmp_path, text, unit):
    (tmp_path / "t.csv").write_text(text, encoding="utf-8", newline="")
    points = read_csv(tmp_path / "t.csv")
    assert [n.upper() for n in points.landmarks.names] == ["LASI"] and points.fps == 2
    np.testing.assert_allclose(points.points_world[0, 0], np.array([1, 2, 3]) * {"m": 1, "mm": 1e-3}[unit])
    assert np.isnan(points.points_world[1]).all()
    turned = read_csv(tmp_path / "t.csv", unit="cm", up="y", fps=10)
    np.testing.assert_allclose(turned.points_world[0, 0], [0.03, 0.01, 0.02])
    assert turned.fps == 10


def test_one_row_a_landmark_may_leave_out_what_is_missing(tmp_path):
    rows = ["frame,landmark,x,y,z", "7,nose,1,1,1", "9,nose,3,3,3", "9,left_ear,4,4,4"]
    (tmp_path / "t.csv").write_text("\n".join(rows))
    points = read_csv(tmp_path / "t.csv", fps=30)
    assert points.points_world.shape == (3, 2, 3) and np.isnan(points.points_world[1]).all()
    assert points.points_world[2, 1, 0] == 4 and np.isnan(points.points_world[0, 1]).all()


GOOD = "time,a_x,a_y,a_z\n0,1,2,3\n0.5,4,5,6\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        ("# only\n", "is empty"),
        (GOOD.replace("a_z", "b_z"), "no landmark has columns"),
        (GOOD.replace("a_y", "a_x"), "'a_x' appears more than once"),
        (GOOD.replace("a_z", "a_z,a.x").replace("3\n", "3,3\n").replace("6\n", "6,6\n"), "two columns for x"),
        (GOOD.replace("0,1,2,3", "0,1,two,3"), "line 2, column 'a_y': 'two'"),
        (GOOD.replace("0,1,2,3", "0,1,2"), "line 2 has 3 cells"),
        (GOOD.replace("0.5,4", "0,4"), "no column of rising times"),
        (GOOD.replace("a_x", "a_x_mm").replace("a_y", "a_y_cm"), "several units"),
        ("time,a_x,a_y,a_z\n", "no row of points"),
        ("frame,x,y,z\n1,1,1,1\n", "none called name"),
        ("name,x,y,z\na,1,1,1\n", "none called frame"),
        ("frame,name,x,y,z\n1,a,1,1,1\n1,a,2,2,2\n", "two rows in one frame"),
    ],
)
def test_malformed_csv(tmp_path, text, says):
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(FormatError, match=says) as raised:
        read_csv(tmp_path / "bad.csv", fps=None if "rising" in says else 30.0)
    assert "bad.csv" in str(raised.value) and "\n" not in str(raised.value)


def test_npz_of_others(tmp_path):
    if not DATA.is_dir():
        pytest.skip("../shared/data is not here")
    points = read_npz(DATA / "balancing" / "reference" / "openpose_body25b.npz", fps=60)
    assert points.points_world.shape == (100, 25, 3) and "left_big_toe" in points.landmarks.names


@pytest.mark.parametrize(
    ("arrays", "says"),
    [
        ({}, "needs `points_world`"),
        ({"points_world": np.zeros((3, 2))}, "needs `points_world`"),
        ({"points_world": np.zeros((3, 2, 3))}, "needs `names`"),
        ({"points_world": np.zeros((3, 2, 3)), "names": np.array(["a"])}, "one text for each of 2"),
        ({"points_world": np.zeros((3, 2, 3)), "names": np.array(["a", "b"])}, "has no `fps`"),
        ({"points_world": np.zeros((3, 2, 3)), "names": np.array(["a", "b"]), "fps": np.array(-1)}, "has no `fps`"),
        ({"points_world": np.zeros((0, 2, 3)), "names": np.array(["a", "b"]), "fps": np.array(9)}, "has no frame"),
        ({"points_world": np.array([{}], object)}, "not an .npz: .* holds objects"),
    ],
)
def test_malformed_npz(tmp_path, arrays, says):
    np.savez(tmp_path / "bad.npz", **arrays)
    with pytest.raises(FormatError, match=says):
        read_npz(tmp_path / "bad.npz")


@pytest.mark.parametrize("name", ["[" * 20000, "a" + "[" * 12000 + "x" + "[" * 12000, "_" * 20000 + "q"])
def test_long_runs_of_separators_in_a_column_name_take_no_time(tmp_path, name):
    path = tmp_path / "a.csv"
    path.write_text(f"time,{name}\n0,1\n0.1,2\n")
    start = time.process_time()
    with pytest.raises(FormatError, match="no landmark has columns"):
        read_csv(path)
    assert time.process_time() - start < 1.0  # of this process, whatever else runs


@pytest.mark.parametrize(("head", "name"), [("_{}", ""), ("__{}", "_"), ("a _{}", "a"), ("[a] ({})", "[a]")])
def test_separators_before_the_axis_are_no_part_of_the_name(tmp_path, head, name):
    path = tmp_path / "a.csv"
    path.write_text("time," + ",".join(head.format(axis) for axis in "xyz") + "\n0,1,2,3\n0.1,1,2,3\n")
    if not name:
        with pytest.raises(FormatError, match="no landmark has columns"):
            read_csv(path)
    else:
        assert read_csv(path).landmarks.names == (name,)
