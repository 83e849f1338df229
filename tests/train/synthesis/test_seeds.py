"""Outfits and labels of a seed stay the same between versions."""

import hashlib

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("kornia")
pytest.importorskip("moderngl")

from muybridge.geometry.landmarks.marker_sets import SURFACE  # noqa: E402
from muybridge.train.images.backgrounds import make_backgrounds  # noqa: E402
from muybridge.train.images.compositor import Compositor  # noqa: E402
from muybridge.train.images.options import AugmentOptions  # noqa: E402
from muybridge.train.images.scenes import SceneCompositor  # noqa: E402
from muybridge.train.synthesis.clothing.sample import KINDS, Outfit, sample_outfit  # noqa: E402
from muybridge.train.synthesis.rendering.store import RenderSet  # noqa: E402


def rounded(value: object) -> object:
    """Numbers to four digits, which no difference between machines reaches."""
    if isinstance(value, str | int):
        return value
    return np.round(np.asarray(value, float), 4).tolist()


def description(outfit: Outfit) -> str:
    values = sorted((name, rounded(value)) for name, value in outfit.values.items())
    accessories = [(a.anchor, rounded(a.points.mean((0, 1))), rounded(a.colour), a.hair) for a in outfit.accessories]
    return repr((outfit.kind, sorted(outfit.parts), rounded(outfit.light), values, accessories, outfit.dots))


def test_outfits_of_a_seed_stay() -> None:
    outfits = [
        sample_outfit(np.random.default_rng(seed), seed % 2, list(KINDS)[seed % 5] if seed % 3 else None)
        for seed in range(120)
    ]
    digest = hashlib.sha256("\n".join(map(description, outfits)).encode()).hexdigest()
    assert digest[:16] == "2054df36e96586c3"
    assert {outfit.kind for outfit in outfits} == set(KINDS) and any(outfit.accessories for outfit in outfits)


@pytest.fixture(scope="module")
def renders() -> RenderSet:
    """Upright rectangles, two of them close-ups."""
    rng, count = np.random.default_rng(0), 6
    pixels = np.zeros((count, 5, 256, 256), np.uint8)
    pixels[:, :3, 30:220, 90:160] = rng.integers(0, 255, (count, 3, 190, 70))
    pixels[:, 3, 30:220, 90:160] = 255
    cut = np.full((count, 3), np.nan, np.float32)
    cut[4:] = [[0, 1, 150], [1, 0, 140]]
    landmarks, markers = (rng.uniform(60, 200, (count, n, 2)).astype(np.float32) for n in (23, len(SURFACE)))
    box = np.tile(np.array([90, 30, 160, 220], np.float32), (count, 1))
    seen = np.ones((count, 23), bool), np.ones((count, len(SURFACE)), bool)
    return RenderSet([pixels], landmarks, seen[0], box, markers, seen[1], cut)


def test_labels_of_crops_and_scenes_of_a_seed_stay(renders: RenderSet) -> None:
    backgrounds = make_backgrounds(4, 256, 3)
    batch = Compositor(renders, backgrounds, 96, 1, AugmentOptions()).batch(32)
    scenes = SceneCompositor(renders, backgrounds, 1).batch(8)
    landmarks = np.concatenate([batch.landmarks_px.numpy(), batch.markers_px.numpy()], 1)
    boxes = [*scenes.boxes, *scenes.ignore]
    assert landmarks.mean(dtype=np.float64) == pytest.approx(48.8221, abs=1e-3)
    assert landmarks.std(dtype=np.float64) == pytest.approx(19.6657, abs=1e-3)
    assert int(batch.visible.sum()) == 547 and int(batch.markers_visible.sum()) == 1707
    assert [len(box) for box in boxes] == [2, 3, 2, 1, 1, 3, 1, 5, 0, 1, 0, 0, 1, 0, 0, 0]
    assert np.concatenate(boxes).mean(dtype=np.float64) == pytest.approx(169.750, abs=1e-2)
