"""Scores and calibration of keypoint networks."""

import json
from dataclasses import replace

import numpy as np
import pytest

onnx = pytest.importorskip("onnx")
torch = pytest.importorskip("torch")
pytest.importorskip("kornia")

from muybridge.errors import SessionError  # noqa: E402
from muybridge.geometry.landmarks.sets import BODY23  # noqa: E402
from muybridge.models.keypoints.metadata import keypoint_card  # noqa: E402
from muybridge.models.people.metadata import people_card  # noqa: E402
from muybridge.models.shipped import shipped_model  # noqa: E402
from muybridge.train.images.backgrounds import make_backgrounds  # noqa: E402
from muybridge.train.images.compositor import Batch, Compositor  # noqa: E402
from muybridge.train.images.options import WHOLE  # noqa: E402
from muybridge.train.keypoints import train as keypoints  # noqa: E402
from muybridge.train.keypoints.evaluate import MIRROR, _figures, evaluate_onnx  # noqa: E402
from muybridge.train.keypoints.options import Evaluation  # noqa: E402
from muybridge.train.keypoints.variance_calibration import fit_spread, within  # noqa: E402
from muybridge.train.synthesis.rendering.store import SIZE, load_renders  # noqa: E402


def test_spread_calibration_covers_errors():
    rng = np.random.default_rng(0)
    spread = rng.uniform(0.5, 40, 8000)
    error = rng.normal(size=(8000, 2)) * np.sqrt(0.7 * spread + 1.5)[:, None]
    fitted = fit_spread(error[:4000], spread[:4000])
    assert fitted.scale == pytest.approx(0.7, rel=0.15)
    one, two = within(error[4000:], fitted.variance(spread[4000:]))
    assert one == pytest.approx(0.683, abs=0.03)
    assert two == pytest.approx(0.954, abs=0.02)


def test_crops_are_also_scored_at_a_smaller_size():
    seen = {}

    class Found(torch.nn.Module):
        """Finds every landmark in the middle, where it is, and in smaller crops a cell right of it."""

        def __init__(self):
            super().__init__()
            self.weight = torch.nn.Parameter(torch.zeros(1))

        def forward(self, image):
            side = image.shape[-1]
            seen[side] = seen.get(side, 0) + 1
            maps = torch.full((len(image), 23, side // 4, side // 4), -9.0)
            middle, right = side // 8, int(side < 64)
            maps[:, :, middle - 1 : middle + 1, middle - 1 + right : middle + 1 + right] = 9.0
            return maps, None

    at = torch.full((2, 23, 2), 31.5)
    batch = Batch(
        torch.zeros(2, 3, 64, 64, dtype=torch.uint8), torch.zeros(2, 1, 64, 64, dtype=torch.uint8), at,
        torch.ones(2, 23, dtype=torch.bool), torch.zeros(2, 0, 2), torch.ones(2, 0, dtype=torch.bool),
    )  # fmt: skip
    scores = keypoints.evaluate(Found(), [batch])
    assert seen == {64: 1, 32: 1}
    assert scores["median_px"] == pytest.approx(0, abs=1e-3)
    assert scores["pck05"] == 1 and scores["pck05_smaller"] == 0


class _Says(torch.nn.Module):
    """A network that is sure of the places it is given, by so much."""

    def __init__(self, landmarks_px, confidence):
        super().__init__()
        self.confidence = torch.nn.Parameter(torch.tensor(confidence))
        self.cell = (landmarks_px - 1.5) / 4

    def forward(self, image):
        at = torch.arange(16.0)
        x, y = ((at - self.cell[..., axis, None]) ** 2 / (2 * 0.8**2) for axis in (0, 1))
        return -self.confidence * (y[..., :, None] + x[..., None, :]), None


def test_scores_measure_errors_flips_and_confidence():
    at = torch.from_numpy(np.random.default_rng(3).uniform(8, 56, (2, 23, 2))).float()
    seen, empty = torch.ones(2, 23, dtype=torch.bool), torch.empty(2, 0)
    image, difference = (torch.zeros(2, channels, 64, 64, dtype=torch.uint8) for channels in (3, 1))
    batch = Batch(image, difference, at, seen, empty, empty)
    right, sure, exchanged, unsurely = (
        keypoints.evaluate(_Says(places, confidence), [batch])
        for places, confidence in ((at, 1.0), (at, 9.0), (at[:, MIRROR], 1.0), (at[:, MIRROR], 0.3))
    )
    assert right["pck05"] == sure["pck05"] == 1 and right["flips"] == 0
    assert exchanged["flips"] == unsurely["flips"] == 1
    # Of a Gaussian over the cells the entropy is the least loss; who is too sure, or wrong, has more.
    assert right["held_out_loss"] == pytest.approx(np.log(2 * np.pi * np.e * 0.8**2), abs=0.02)
    assert right["held_out_loss"] < sure["held_out_loss"]
    assert right["held_out_loss"] < unsurely["held_out_loss"] < exchanged["held_out_loss"]


def test_evaluation_figures_match_their_definition():
    count, pairs = 4, [BODY23.index("left_knee"), BODY23.index("right_knee")]
    distance, visible = np.zeros((count, 23)), np.ones((count, 23), bool)
    twin = np.where(MIRROR == np.arange(23), 0.0, 60.0) * np.ones((count, 1))
    found = _figures(distance, twin, np.full((count, 23, 2), 0.5), visible, visible, 192)
    assert found["PCK@0.05 of the box"] == 1 and found["left-right flips"] == 0 and found["within 1 sigma (0.683)"] == 1
    # One person's knees have changed places; they count unless they are hidden.
    distance[0, pairs], twin[0, pairs] = 60.0, 0.0
    found = _figures(distance, twin, np.full((count, 23, 2), 1.5), visible, visible, 192)
    limbs = int((MIRROR != np.arange(23))[5:].sum()) * count
    assert found["left-right flips"] == pytest.approx(2 / limbs)
    assert found["left-right flips, with face"] == pytest.approx(2 / (23 * count))
    assert found["PCK@0.1 of the box"] == pytest.approx(1 - 2 / (23 * count))
    # Of four crops one has both swaps: the error of the mean of 2, 0, 0, 0 in units of 23 landmarks.
    assert found["flips, standard error"] == pytest.approx(np.std([2, 0, 0, 0], ddof=1) / 2 / 23)
    assert found["within 1 sigma (0.683)"] == 0 and found["within 2 sigma (0.954)"] == 1
    visible[0, pairs] = False
    assert _figures(distance, twin, np.zeros((count, 23, 2)), visible, visible, 192)["left-right flips"] == 0


def test_evaluation_with_and_without_difficulties(store, tmp_path, monkeypatch):
    # Whether sticks are to be turned depends on the weights; here whatever is unsure is.
    monkeypatch.setattr("muybridge.models.keypoints.test_time._GAIN", -100.0)
    monkeypatch.setattr(
        "muybridge.train.keypoints.evaluate.make_backgrounds", lambda count, *how: make_backgrounds(8, *how)
    )
    small = onnx.load(str(shipped_model("keypoints")))
    for fact in small.metadata_props:
        fact.value = "96" if fact.key == "input_size" else fact.value  # a seventh of the time
    onnx.save(small, str(tmp_path / "small.onnx"))
    options = Evaluation(tmp_path / "small.onnx", renders=store, crops=12)
    found = evaluate_onnx(options)
    assert all(np.isfinite(v) for v in found.values()) and found == evaluate_onnx(options)  # seeded
    plain = evaluate_onnx(replace(options, faults=False, occlusion=False))
    assert plain != found
    assert evaluate_onnx(replace(options, flip=False)) != found
    assert evaluate_onnx(replace(options, plate=False)) != found
    assert evaluate_onnx(replace(options, backdrop=True, tinted=True, monochrome=True)) != found
    assert evaluate_onnx(replace(options, all_shards=True)) != found  # of other people too
    assert evaluate_onnx(replace(options, turn=False)) != found
    with pytest.raises(SessionError, match="muybridge synth"):
        evaluate_onnx(replace(options, renders=tmp_path / "none"))


def test_crops_without_faults_are_sharp(store):
    renders, backgrounds = load_renders(store), np.full((4, 3, SIZE, SIZE), 90, np.uint8)
    nothing = replace(
        WHOLE, scale_sd=0, shift_sd=0, rotation_sd_deg=0, tumble=0, second_person=0, occluder=0, mosaic=0, truncate=0,
        clutter=0,
    )  # fmt: skip
    edges = []
    for faults in (False, True):
        image = Compositor(renders, backgrounds, 192, 0, replace(nothing, faults=faults)).batch(64).image.float()
        edges.append(float((image[..., 1:] - image[..., :-1]).abs().amax((1, 2, 3)).median()))
    assert edges[0] > 1.15 * edges[1]


@pytest.mark.parametrize(("kind", "card"), [("keypoints", keypoint_card), ("people", people_card)])
def test_shipped_weights_record_their_training(kind, card):
    import onnxruntime

    path = shipped_model(kind)
    metadata = onnxruntime.InferenceSession(str(path)).get_modelmeta().custom_metadata_map
    assert card(metadata, path).metadata["training_command"].startswith("muybridge train")
    assert json.loads(metadata["training"])["images"] > 100_000
    assert "scores" in metadata and "seed" in metadata and "synthetic" in metadata["licence"]
