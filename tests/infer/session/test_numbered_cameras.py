"""Cameras and videos that are counted from different numbers."""

from pathlib import Path

import pytest

from muybridge.errors import SessionError
from muybridge.infer.session.discover import select_cameras
from muybridge.infer.session.pairing import match_cameras
from tests.rigs import ring_of_cameras

HERE, FILE = Path("session"), Path("session/calibration.toml")


@pytest.mark.parametrize("first", [0, 1])
def test_cameras_and_videos_counted_from_different_numbers_are_never_paired_with_neighbours(first):
    names, stems = ([f"cam{k}" for k in range(start, start + 4)] for start in (first, 1 - first))
    with pytest.raises(SessionError) as caught:
        match_cameras(stems, names, HERE, FILE)
    said = str(caught.value)
    assert "--cameras" not in said
    assert f"rename {stems[0]} to {names[0]}, {stems[1]} to {names[1]}, {stems[2]} to {names[2]}" in said
    group = ring_of_cameras(names, size=(64, 48), model="PINHOLE", params=[(60.0, 60.0, 31.5, 23.5)] * 4)
    with pytest.raises(SessionError, match=f"numbered differently; .*{stems[3]} to {names[3]}"):
        select_cameras(group, [Path(f"{s}.mp4") for s in stems], tuple(names[1:3]), FILE)


def test_a_proposal_never_pairs_neighbours():
    with pytest.raises(SessionError, match="counted from different numbers") as caught:
        match_cameras(["cam1", "cam2", "cam3", "cam4", "cam5"], ["cam0", "cam1", "cam2", "cam3"], HERE, FILE)
    assert "--cameras" not in str(caught.value)
    with pytest.raises(SessionError, match="--cameras cam1 cam2"):
        match_cameras(["cam1", "cam2"], ["cam1", "cam2", "cam3"], HERE, FILE)
