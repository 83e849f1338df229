"""Camera faults."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("kornia")

import cv2  # noqa: E402
import kornia  # noqa: E402

from muybridge.train.images.camera_faults import CameraFaults, other_hue, through_bayer, through_h264  # noqa: E402


@pytest.fixture(scope="module")
def picture():
    noise = np.random.default_rng(0).random((64, 96, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 5)
    return ((smooth - smooth.min()) / np.ptp(smooth) * 255).astype(np.uint8)


@pytest.mark.parametrize("fault", [through_bayer, lambda p: through_h264(p, 20)])
def test_sensor_and_codec_keep_colours_and_places(picture, fault):
    after = fault(picture)
    assert after.shape == picture.shape and after.dtype == np.uint8
    error = np.abs(after.astype(float) - picture).mean()
    assert 0 < error < 6
    # Neither channels nor rows are exchanged: any such exchange is far worse.
    assert error < 0.5 * np.abs(after[..., ::-1].astype(float) - picture).mean()
    assert error < 0.5 * np.abs(after[::-1].astype(float) - picture).mean()


def test_codec_loses_more_at_higher_quantisers(picture):
    loss = [np.abs(through_h264(picture, q).astype(float) - picture).mean() for q in (18, 30, 44)]
    assert loss[0] < loss[1] < loss[2]


def test_faults_are_seeded_finite_and_leave_most_of_the_image(picture):
    batch = torch.from_numpy(picture).permute(2, 0, 1).float()[None].repeat(32, 1, 1, 1) / 255
    first = CameraFaults(np.random.default_rng(3)).apply(batch.clone())
    again = CameraFaults(np.random.default_rng(3)).apply(batch.clone())
    assert torch.equal(first, again) and torch.isfinite(first).all()
    grey = batch.mean(1).flatten(1)
    after = first.mean(1).flatten(1)
    kept = [np.corrcoef(a, b)[0, 1] for a, b in zip(grey.numpy(), after.numpy(), strict=True)]
    assert np.median(kept) > 0.8


@pytest.mark.parametrize("turn", [-0.25, 0.0, 0.1])
def test_hue_rotation_matches_kornia(picture, turn):
    image = torch.from_numpy(picture).permute(2, 0, 1).float() / 255
    assert (other_hue(image, turn) - kornia.enhance.adjust_hue(image, turn)).abs().max() < 1e-3
    assert turn or (other_hue(image, turn) - image).abs().max() < 1e-3
