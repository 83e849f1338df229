"""`muybridge run --refine-cameras`: cameras that were turned are put right, right ones are left alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.arrays import Keypoints2D
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.infer.reconstruction import refine_cameras
from muybridge.infer.runtime.progress import Progress
from muybridge.infer.runtime.stages import StageStore
from muybridge.infer.session.session import Session, SessionOptions, open_session


@pytest.fixture
def filmed(repository: Path) -> tuple[Session, Keypoints2D]:
    """The demo take with the 2D of a network: noise, and what each view has wrong all the time."""
    take = repository / "infer" / "demo_take"
    session = open_session(take, SessionOptions())
    with np.load(take / "truth.npz") as truth:
        columns = [list(truth["names"]).index(n) for n in BODY23.names]
        pixels = session.cameras.project(truth["points_world"][:, columns])
    rng = np.random.default_rng(0)
    pixels += rng.normal(0, 1, pixels.shape) + rng.normal(0, 2, (len(pixels), 1, *pixels.shape[2:]))
    seen = np.ones(pixels[:, :, None].shape[:-1])
    return session, Keypoints2D(BODY23, pixels[:, :, None], seen, seen)


def turned(cameras: CameraGroup, degrees: float) -> CameraGroup:
    first = cameras[0]
    rotation = Rotation.from_euler("y", degrees, degrees=True).as_matrix() @ first.rotation
    pose = np.column_stack([rotation, -rotation @ first.center_world])
    return CameraGroup((first.posed(pose), *list(cameras)[1:]))


def test_correct_cameras_stay(filmed: tuple[Session, Keypoints2D], tmp_path: Path) -> None:
    session, keypoints = filmed
    found, _ = refine_cameras.refine(session, keypoints, "", StageStore(tmp_path), Progress(quiet=True))
    assert found.cameras == session.cameras
    assert "were not refined" in found.notices[-1]


@pytest.mark.parametrize("degrees", [1.0, 2.0, 4.0])
def test_a_turned_camera_is_turned_back(filmed: tuple[Session, Keypoints2D], tmp_path: Path, degrees: float) -> None:
    session, keypoints = filmed
    wrong = replace(session, cameras=turned(session.cameras, degrees))
    found, _ = refine_cameras.refine(wrong, keypoints, "", StageStore(tmp_path), Progress(quiet=True))
    assert "cam1 by " in found.notices[-1] and "were refined" in found.notices[-1]
    off = [np.degrees(Rotation.from_matrix(rig.cameras[0].rotation @ session.cameras[0].rotation.T).magnitude())
           for rig in (wrong, found)]  # fmt: skip
    assert off[0] == pytest.approx(degrees) and off[1] < 0.5 * degrees


@pytest.mark.parametrize(("after", "better"), [(8.9, True), (9.1, False), (10.5, False)])
def test_a_few_per_cent_are_no_improvement(
    filmed: tuple[Session, Keypoints2D], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, after: float, better: bool
) -> None:
    session, keypoints = filmed
    other = turned(session.cameras, 1.0)
    monkeypatch.setattr(refine_cameras, "_poses", lambda *_: (other.cam_from_world, 10.0, after))
    found, stage = refine_cameras.refine(session, keypoints, "", StageStore(tmp_path), Progress(quiet=True))
    assert found.cameras == (other if better else session.cameras) and stage is not None
    assert ("hardly improve them" in found.notices[-1]) != better
