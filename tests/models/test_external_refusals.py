"""Cards and files of third-party models that are refused."""

from pathlib import Path

import pytest

pytest.importorskip("onnx")

from muybridge.errors import ModelError  # noqa: E402
from muybridge.infer.detection.detect import DetectOptions  # noqa: E402
from muybridge.infer.detection.pose_estimator import KeypointOptions  # noqa: E402
from muybridge.infer.networks.external import open_keypoints  # noqa: E402
from muybridge.infer.networks.keypoints import OnnxOptions  # noqa: E402
from muybridge.infer.networks.models import open_models  # noqa: E402
from muybridge.models.keypoints.external import load_card  # noqa: E402
from tests.models.test_external import _bright_spot_model  # noqa: E402
from tests.paths import DATA  # noqa: E402


@pytest.mark.parametrize("name", ["deep_card.toml", "num_card.toml"])
def test_cards_that_went_wrong(name: str) -> None:
    path = DATA / "cases" / "card_deep" / name
    if not path.exists():
        pytest.skip(f"{path} is absent")
    with pytest.raises(ModelError) as caught:
        load_card(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_size_of_crops_and_huge_batches_are_refused(tmp_path: Path) -> None:
    path = _bright_spot_model(tmp_path / "model.onnx", 17)
    with pytest.raises(ModelError, match="size of crops"):
        open_models(DetectOptions(keypoints=KeypointOptions(onnx=OnnxOptions(size=0.75)), keypoint_model=path,
                                  model_card="rtmpose-coco17"))  # fmt: skip
    path = _bright_spot_model(tmp_path / "many.onnx", 17, batch=10**6)
    with pytest.raises(ModelError, match="takes 1000000 images"):
        open_keypoints(path, "rtmpose-coco17", OnnxOptions())
