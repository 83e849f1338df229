"""Renders that the network finds hard are drawn more often."""

import pathlib

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("kornia")

from muybridge.errors import ModelError  # noqa: E402
from muybridge.train.images import dataset  # noqa: E402
from muybridge.train.keypoints import train as keypoints  # noqa: E402
from muybridge.train.keypoints.hard_examples import Difficulty, drawing_probability, read_difficulty  # noqa: E402
from muybridge.train.keypoints.options import KeypointTraining  # noqa: E402
from muybridge.train.synthesis.rendering.store import SHARD, load_renders  # noqa: E402

pytestmark = pytest.mark.usefixtures("few_held_out")


def test_losses_are_averaged_and_shared_by_file(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "difficulty.npy"
    noted = Difficulty(path, every=2)
    assert not len(read_difficulty(path))
    noted.record(np.array([3, 0]), np.array([2.0, np.nan], np.float32))
    assert not path.exists()
    noted.record(np.array([3, 5]), np.array([4.0, 1.0], np.float32))
    loss = read_difficulty(path)
    np.testing.assert_array_equal(np.isnan(loss), [True, True, True, False, True, False])
    assert 2 < loss[3] < 3 and loss[5] == 1
    # Another call goes on from the file.
    again = Difficulty(path, every=1)
    again.record(np.array([3]), loss[3:4])
    np.testing.assert_allclose(read_difficulty(path), loss)


def test_drawing_probability_mixes_loss_and_uniform() -> None:
    loss = np.array([1.0, 1.0, 1.0, 1.0, 3.0, 5.0], np.float32)
    p = drawing_probability(loss, 6, 0.6)
    np.testing.assert_allclose(p, 0.4 / 6 + 0.6 * np.array([0, 0, 0, 0, 2, 4]) / 6)
    np.testing.assert_allclose(drawing_probability(loss, 6, 0.0), 1 / 6)
    np.testing.assert_allclose(drawing_probability(np.ones(6, np.float32), 6, 0.6), 1 / 6)
    # Of whom nothing is known yet counts as the mean; a store may have grown or shrunk.
    grown = drawing_probability(loss, 8, 0.6)
    np.testing.assert_allclose(grown[6:], 0.4 / 8 + 0.6 / 8)
    assert grown.sum() == pytest.approx(1)
    assert drawing_probability(loss, 3, 0.6) == pytest.approx(1 / 3)
    assert drawing_probability(np.zeros(0, np.float32), 4, 0.6) == pytest.approx(1 / 4)


def test_hard_renders_are_drawn_more_often(store: pathlib.Path, tmp_path: pathlib.Path) -> None:
    options = KeypointTraining(renders=store, out=tmp_path / "run", size=64, backgrounds=8, workers=0, hard=0.5)
    pool, path = dataset.background_pool(options), tmp_path / "difficulty.npy"
    loss = np.ones(SHARD, np.float32)
    loss[[7, 100]] = 4
    np.save(path, loss)
    crops = keypoints._Crops(pool, 64, 0.0, 64, path, options.hard)
    following = crops(load_renders(store, dataset.TRAINED_ON), seed=1)
    drawn = np.concatenate([following()[3].numpy() for _ in range(4)])
    share = np.isin(drawn, [7, 100]).mean()
    assert 0.38 < share < 0.62
    assert len(np.unique(drawn)) > 80


def test_invalid_shares_are_refused(tmp_path: pathlib.Path) -> None:
    with pytest.raises(ModelError, match=r"--hard 1\.5: .* 0 to 1"):
        keypoints.train(KeypointTraining(renders=tmp_path, out=tmp_path / "run", hard=1.5))
    with pytest.raises(ModelError, match=r"--smaller -1: .* 0 to 1"):
        keypoints.train(KeypointTraining(renders=tmp_path, out=tmp_path / "run", smaller=-1))


def test_training_records_hard_renders(
    store: pathlib.Path, tmp_path: pathlib.Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keypoints, "_REFRESH_BATCHES", 2)
    noted: list[float] = []
    draw = keypoints.drawing_probability

    def drawing(loss: np.ndarray, count: int, hard: float) -> np.ndarray:
        noted.append(np.isfinite(loss).mean() if len(loss) else 0.0)
        return draw(loss, count, hard)

    monkeypatch.setattr(keypoints, "drawing_probability", drawing)
    monkeypatch.setattr(keypoints, "Difficulty", lambda path: Difficulty(path, every=1))
    keypoints.train(KeypointTraining(
        renders=store, out=tmp_path / "run", minutes=0.06, size=64, batch=16, backgrounds=8, workers=0, hard=0.5
    ))  # fmt: skip
    assert noted[0] == 0 and noted[-1] > 0.05
    (noted_in,) = (tmp_path / "run").glob("difficulty-*.npy")
    known = read_difficulty(noted_in)
    assert (known[np.isfinite(known)] > 0).all()
