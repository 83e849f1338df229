"""Rows that are missing, out of order or cut off, times, and units, in TRC and tables."""

import numpy as np
import pytest

from muybridge.errors import FormatError
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.sets import LandmarkSet
from muybridge.motion.formats.points.csv import read_csv
from muybridge.motion.formats.points.trc import read_trc, write_trc
from muybridge.motion.formats.points.unlabelled import read_marker_cloud

ROWS = 10


def save_trc(path, edit=lambda lines: lines, names=("LASI", "RASI")):
    """Ten frames at 100 Hz in which x of the file is the frame's number from 1."""
    xyz = np.tile(np.arange(1.0, ROWS + 1)[:, None, None], (1, len(names), 3))
    none = np.empty((0, *xyz.shape[:2]))
    unknown = np.full((*xyz.shape, 3), np.nan)
    write_trc(path, Points3D(LandmarkSet("m", names, ()), xyz, unknown, none, none.astype(bool), 100.0))
    lines = path.read_text().split("\n")[:-1]
    path.write_text("\n".join(edit(lines)) + "\n")


def table(frames=None, times=None, head="LASI_x,LASI_y,LASI_z", values=None):
    """A table of one marker that is where its frame's number from 1 says."""
    values = np.arange(1, ROWS + 1) if values is None else values
    columns = ({} if frames is None else {"frame": frames}) | ({} if times is None else {"time": times})
    lines = [",".join([*columns, head])]
    lines += [",".join(f"{c[i]:g}" for c in (*columns.values(), values, values, values)) for i in range(len(values))]
    return "\n".join(lines) + "\n"


def test_a_trc_that_ends_too_early_is_refused(tmp_path):
    save_trc(tmp_path / "a.trc", lambda lines: lines[:-4])
    with pytest.raises(FormatError, match="states 10 frames, 6 rows follow"):
        read_trc(tmp_path / "a.trc")
    save_trc(tmp_path / "b.trc")
    whole = (tmp_path / "b.trc").read_text()
    (tmp_path / "b.trc").write_text(whole[:-20])
    with pytest.raises(FormatError, match="line 16 ends before its last marker"):
        read_trc(tmp_path / "b.trc")
    (tmp_path / "b.trc").write_text(whole.rstrip("\n"))
    assert len(read_trc(tmp_path / "b.trc").points_world) == ROWS


def test_rows_of_a_trc_are_placed_by_their_numbers(tmp_path):
    def without(lines):
        del lines[9:13]
        lines[2] = lines[2].replace("\t10\t2\t", "\t6\t2\t")
        return [*lines[:-2], lines[-1], lines[-2]]

    save_trc(tmp_path / "a.trc", without)
    x = read_trc(tmp_path / "a.trc").points_world[:, 0, 0]
    np.testing.assert_allclose(x, [1, 2, 3, *[np.nan] * 4, 8, 9, 10])
    save_trc(tmp_path / "b.trc", lambda lines: [*lines, lines[-1]])
    with pytest.raises(FormatError, match="2 rows are of frame 10"):
        read_trc(tmp_path / "b.trc")


@pytest.mark.parametrize("read", [read_csv, read_marker_cloud])
def test_rows_of_a_table_are_placed_by_their_numbers(tmp_path, read):
    def x(text, fps=None):
        (tmp_path / "t.csv").write_text(text)
        got = read(tmp_path / "t.csv", fps)
        return got.fps, (got.points if read is read_marker_cloud else got.points_world)[:, 0, 0]

    frames = np.array([1, 2, 3, 8, 10, 9])
    rate, there = x(table(frames + 500, frames / 50, values=frames))
    assert rate == 50
    np.testing.assert_allclose(there, [1, 2, 3, *[np.nan] * 4, 8, 9, 10])
    assert len(x(table(frames=[1, 3, 5, 7, 11], times=[0, 0.02, 0.04, 0.06, 0.1], values=np.ones(5)))[1]) == 6
    for times, said in (([0, 0.1, 0.2, 0.5, 0.6], "between the times 0.2 and 0.5"), ([0, 0.2, 0.1], "time falls")):
        with pytest.raises(FormatError, match=said):
            x(table(times=times, values=np.ones(len(times))))
    assert x(table(times=[0, 0.1, 0.2, 0.5, 0.6], values=np.ones(5)), 10)[0] == 10
    for rate in (60, 120, 1000 / 7):  # times that are rounded, or that jitter
        assert x(table(times=np.round(np.arange(ROWS) / rate, 3)))[0] == pytest.approx(rate, rel=0.05)
    with pytest.raises(FormatError, match="0.1 frames per second: are they milliseconds.*pass `fps`"):
        x(table(times=np.arange(ROWS) * 10.0))


def test_a_long_table_with_a_missing_frame_has_a_rate(tmp_path):
    rows = [f"{k},{k / 50},LASI,{k},1,1" for k in range(1, 9) if k not in (4, 5)]
    (tmp_path / "t.csv").write_text("\n".join(["frame,time,name,x,y,z", *rows]))
    points = read_csv(tmp_path / "t.csv")
    assert points.fps == 50
    np.testing.assert_allclose(points.points_world[:, 0, 0], [1, 2, 3, np.nan, np.nan, 6, 7, 8])


@pytest.mark.parametrize(("word", "metres"), [
    ("Millimeters", 1e-3), ("mm", 1e-3), ("millimetre", 1e-3), ("Meters", 1.0), ("centimeter", 0.01), ("in", 0.0254),
    ("inch", 0.0254), ("Inches", 0.0254),
])  # fmt: skip
def test_every_reader_knows_the_words_for_units(tmp_path, word, metres):
    save_trc(tmp_path / "a.trc", lambda lines: [*lines[:2], lines[2].replace("\tm\t", f"\t{word}\t"), *lines[3:]])
    head = ",".join(f"A {c} ({word})" for c in "xyz")
    (tmp_path / "a.csv").write_text(table(range(ROWS), np.arange(ROWS) / 50, head))
    assert read_trc(tmp_path / "a.trc").points_world[9, 0, 0] == pytest.approx(10 * metres)
    assert read_csv(tmp_path / "a.csv").points_world[9, 0, 0] == pytest.approx(10 * metres)
    for name in ("a.trc", "a.csv"):
        assert read_marker_cloud(tmp_path / name).points[9, 0, 0] == pytest.approx(10 * metres)


@pytest.mark.parametrize(("separator", "point"), [(",", "."), (";", ","), (";", "."), ("\t", ".")])
def test_unnamed_points_may_be_separated_in_any_way(tmp_path, separator, point):
    def written(text):
        return text.replace(",", separator).replace(".", point) if separator != "," else text

    (tmp_path / "a.csv").write_text(written(table(range(ROWS), np.arange(ROWS) / 50, values=np.arange(ROWS) + 0.5)))
    cloud = read_marker_cloud(tmp_path / "a.csv")
    assert cloud.fps == 50 and cloud.points[9, 0, 0] == 9.5
    lines = ["Trajectories", "50", ",,S:*1,,,S:*2,,", "Frame,Sub Frame,X,Y,Z,X,Y,Z", ",,mm,mm,mm,mm,mm,mm"]
    lines += [f"{k},0,1.5,2,3,4,5,6" for k in (1, 2, 4)]
    (tmp_path / "v.csv").write_text(written("\n".join(lines)))
    cloud = read_marker_cloud(tmp_path / "v.csv")
    assert cloud.names == ("S:*1", "S:*2") and cloud.fps == 50 and cloud.points[0, 0, 0] == pytest.approx(0.0015)
    assert np.isnan(cloud.points[2]).all() and len(cloud.points) == 4


@pytest.mark.parametrize("name", ["a.trc", "a.csv"])
def test_text_in_another_encoding_is_called_that(tmp_path, name):
    (tmp_path / name).write_bytes("Hüfte_x,y,z".encode("latin-1"))
    for read in (read_trc if name == "a.trc" else read_csv, read_marker_cloud):
        with pytest.raises(FormatError, match="not text in UTF-8.*save it as UTF-8"):
            read(tmp_path / name)
