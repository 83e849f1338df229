"""Runs on videos that are damaged, end early or are results themselves: said, left out, refused; never a traceback."""

import json
import random
import re
from pathlib import Path

import av
import numpy as np
import pytest

from muybridge.geometry.landmarks.sets import BODY23


def _flip_bits(path: Path, seed: int, count: int = 6) -> None:
    """Damage the packets of a video; its container stays whole."""
    rng = random.Random(seed)
    with av.open(str(path)) as container:
        places = [(p.pos, p.size) for p in container.demux(video=0) if p.size > 40 and p.pos is not None]
    data = bytearray(path.read_bytes())
    for _ in range(count):
        begin, size = rng.choice(places)
        data[rng.randrange(begin + 12, begin + size)] ^= 1 << rng.randrange(8)
    path.write_bytes(data)


def _notices(out: Path) -> list[str]:
    return json.loads((out / "run.json").read_text(encoding="utf-8"))["notices"]


def _seen(out: Path, camera: str) -> np.ndarray:
    """(T,) whether a camera has the person."""
    with np.load(out / "work" / f"landmarks-{camera}.npz") as stage:
        return (stage["array_ids"] >= 0).any(1)


def test_damaged_frames_are_said_and_left_out(take, staged, tmp_path):
    video = take / "videos" / "cam2.mp4"
    _flip_bits(video, 3)
    done = staged("run", take, "--out", tmp_path / "out", "--quiet")
    assert done.returncode == 0, done.stderr
    said = [text for text in _notices(tmp_path / "out") if "damaged" in text]
    assert len(said) == 1 and said[0].startswith("cam2.mp4: frame")
    seen = _seen(tmp_path / "out", "cam2")
    assert not seen.all() and _seen(tmp_path / "out", "cam1").all()


@pytest.mark.parametrize("seed", range(3))
def test_no_damage_ends_in_a_traceback(take, staged, tmp_path, seed):
    for camera in ("cam1", "cam3"):
        _flip_bits(take / "videos" / f"{camera}.mp4", seed, 60)
    done = staged("run", take, "--out", tmp_path / "out", "--quiet")
    assert "Traceback" not in done.stderr
    if done.returncode:
        assert done.returncode == 2 and re.search(r"cam[13]\.mp4.*(damaged|cannot be decoded)", done.stderr)
    else:
        assert any("damaged" in text for text in _notices(tmp_path / "out"))


def test_a_camera_that_stops_early_is_used_up_to_its_end(make_session, make_video, staged, tmp_path):
    take = make_session(frames=40, width=160, height=120)
    make_video(take / "videos" / "cam2.mp4", frames=20, width=160, height=120)
    done = staged("run", take, "--out", tmp_path / "out", "--quiet")
    assert done.returncode == 0, done.stderr
    record = json.loads((tmp_path / "out" / "run.json").read_text(encoding="utf-8"))
    assert record["frames"] == 40 and record["quality"]["coverage"] > 0.9
    assert any("cam2.mp4 at frame 20 of the take ends early" in text for text in record["notices"])
    assert not any("frozen" in text or "repeats" in text for text in record["notices"])
    assert _seen(tmp_path / "out", "cam2").tolist() == [True] * 20 + [False] * 20


def test_a_second_run_writes_the_same_overlays_and_results_are_refused(take, staged, tmp_path):
    for name in ("a", "b"):
        assert staged("run", take, "--out", tmp_path / name, "--quiet").returncode == 0
    for camera in ("cam1", "cam2", "cam3"):
        a, b = ((tmp_path / name / f"overlay_{camera}.mp4").read_bytes() for name in ("a", "b"))
        assert a == b
    refused = staged("run", tmp_path / "a", "--out", tmp_path / "c", "--quiet")
    assert refused.returncode == 2
    assert "is a results folder" in refused.stderr and len(refused.stderr.strip().splitlines()) == 1


def test_mirrored_videos_are_refused_and_nobody_else_is_blamed(take, staged, staged_people, monkeypatch, tmp_path):
    plain = staged_people.StagedEstimator.finish

    def mirrored(self):
        def turned(name, array):
            if name == "points_px":
                array = array[:, :, list(BODY23.mirror)] * [-1, 1] + [159, 0]
            return array

        return plain(self).map(turned)

    monkeypatch.setattr(staged_people.StagedEstimator, "finish", mirrored)
    done = staged("run", take, "--out", tmp_path / "out", "--quiet")
    assert done.returncode == 2
    assert "cam1.mp4, cam2.mp4, cam3.mp4: all videos are mirrored" in done.stderr and "-vf hflip" in done.stderr
    assert "calibration" not in done.stderr
