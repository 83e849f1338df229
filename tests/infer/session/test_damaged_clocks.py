"""Damaged `sync.toml` and tables of time stamps: one line that names the file and what is wrong."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from muybridge.errors import SessionError
from muybridge.infer.session.sync_file import read_sync
from muybridge.infer.session.timestamps import paired_by_time
from tests.paths import DATA

HEAD = "muybridge_sync = 1\n[cameras.a]\n"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x = " + "[" * 5000, "nested too deeply"),
        (HEAD + "offset = " + "9" * 5000, "exceeds the limit|Exceeds the limit"),
        (HEAD + "offset = 1" + "0" * 24, "offset is 1000000.* at most 1e"),
        (HEAD + "offset = nan", "offset is nan; it must be a finite number"),
        (HEAD + "offset = 1e9", "at most 1e"),
        (HEAD + "drift_ppm = -1e6", "drift_ppm is -1000000.0; .* at most 100000"),
        (HEAD + "offset = true", "offset is True"),
        (HEAD + "offset = [" + "1," * 5000 + "]", "offset is .1, 1, "),
        ("muybridge_sync = 1\ncameras = 3", "needs `muybridge_sync = 1`"),
        ("\xff\xfe", "not a sync.toml"),
    ],
)
def test_a_damaged_sync_file_is_refused_in_one_line(tmp_path, text, says):
    path = tmp_path / "sync.toml"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(SessionError, match=says) as caught:
        read_sync(path, ("a", "b"))
    assert str(path) in str(caught.value) and "\n" not in str(caught.value) and len(str(caught.value)) < 500


@pytest.mark.parametrize("case", ["sync_deep", "sync_int", "sync_int25"])
def test_cases_that_went_wrong(case):
    path = DATA / "cases" / case / "sync.toml"
    if not path.exists():
        pytest.skip(f"{path} is absent")
    with pytest.raises(SessionError) as caught:
        read_sync(path, ("cam01", "cam02"))
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ("5,0,1e300", "line 12 has frame_time '1e300'"),
        ("5,0,nan", "line 12 has frame_time 'nan'"),
        ("5" + "0" * 30 + ",0,0.5", "line 12 has .* sync_index '50000"),
        ("5,0", "line 12 has frame_time None"),
        ("5,,0.5", "line 12 names no camera"),
        ("5,0,1e9", "its times span|not taken at the same time"),
    ],
)
def test_a_damaged_table_of_time_stamps_is_refused_in_one_line(tmp_path: Path, row, says):
    path = tmp_path / "timestamps.csv"
    rows = [f"{t},{c},{t / 10}" for t in range(5) for c in range(2)]
    path.write_text("\n".join(["sync_index,cam_id,frame_time", *rows, row, "5,1,1e9"]))
    videos = [SimpleNamespace(path=Path(f"cam_{c}.mp4"), frames=6) for c in range(2)]
    with pytest.raises(SessionError, match=says) as caught:
        paired_by_time(path, videos)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)
