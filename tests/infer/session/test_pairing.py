"""Which video is of which camera: by name, by order, never of the neighbour."""

from pathlib import Path

import pytest

from muybridge.errors import SessionError
from muybridge.infer.session.discover import select_cameras
from muybridge.infer.session.pairing import match_cameras
from tests.rigs import ring_of_cameras

HERE, FILE = Path("session"), Path("session/calibration.toml")


def paired(stems, names):
    order, said = match_cameras(stems, names, HERE, FILE)
    return [stems[k] for k in order], said


@pytest.mark.parametrize(
    ("stems", "names"),
    [
        (["cam1", "CAM2"], ["Cam1", "cam2"]),
        (["cam_01", "Cam-02"], ["cam1", "cam2"]),
        (["take3_cam1", "take3_cam10", "take3_cam2"], ["cam1", "cam10", "cam2"]),
        (["1_cam1", "1_cam2"], ["1", "2"]),
        (["left side", "right side"], ["left", "right"]),
        (["video1", "video2"], ["Miqus_1_20871", "Miqus_2_20871"]),
        (["b", "a"], ["b", "a"]),
    ],
)
def test_cameras_and_videos_pair_by_name(stems, names):
    videos, said = paired(stems, names)
    assert videos == stems
    assert all("by name" in text for text in said)
    assert bool(said) == any(s.lower() != n.lower() for s, n in zip(stems, names, strict=True))


def test_names_pair_in_the_calibrations_order():
    assert paired(["cam1", "cam2", "cam3"], ["cam3", "cam1", "cam2"])[0] == ["cam3", "cam1", "cam2"]


def test_without_common_names_the_order_decides_and_is_reported():
    videos, said = paired(["GX010019", "GX010020", "GX010101"], ["c10", "c9", "b"])
    assert videos == ["GX010101", "GX010020", "GX010019"]
    assert len(said) == 1 and "c10 = GX010101, c9 = GX010020, b = GX010019" in said[0]


@pytest.mark.parametrize(
    ("stems", "names", "said"),
    [
        (["cam1", "cam2"], ["cam1", "cam2", "cam3"], "no video for camera cam3"),
        (["cam1", "cam2", "cam3"], ["cam1", "cam2"], "no camera for video cam3"),
        (["cam1", "cam2", "cam4"], ["cam1", "cam2", "cam3"], "camera cam3 and .* video cam4"),
        (["cam0", "cam1", "cam2"], ["cam1", "cam2", "cam3"], "camera cam3 and .* video cam0"),
        (["x", "y", "z"], ["cam1", "cam2"], "camera cam1, cam2 and .* video x, y, z"),
    ],
)
def test_unpaired_cameras_and_videos_are_named(stems, names, said):
    with pytest.raises(SessionError, match=f"{said}.*name each video after its camera"):
        match_cameras(stems, names, HERE, FILE)


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
