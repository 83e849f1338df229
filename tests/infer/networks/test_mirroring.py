"""Which crops are read mirrored too."""

import numpy as np
import pytest

from muybridge.infer.networks.keypoints import KeypointNetwork, OnnxOptions
from muybridge.models.shipped import shipped_model


@pytest.mark.parametrize(("flip", "seen"), [(None, [3, 2]), (True, [3, 3]), (False, [3])])
def test_sure_crops_are_not_mirrored_by_default(
    monkeypatch: pytest.MonkeyPatch, flip: bool | None, seen: list[int]
) -> None:
    network = KeypointNetwork(shipped_model("keypoints", "int8"), OnnxOptions(flip=flip, turn=False))
    crops = np.random.default_rng(0).integers(0, 256, (3, 96, 96, 3)).astype(np.uint8)
    run, counts = network._run, []

    def counted(part: np.ndarray) -> object:
        counts.append(len(part))
        return run(part)

    monkeypatch.setattr(network, "_run", counted)
    monkeypatch.setattr("muybridge.infer.networks.keypoints.crop_uncertainty", lambda *_: np.array([2.0, 0.0, 1.0]))
    found = network.locate(crops)
    assert counts == seen
    # The sure crop is as it is without mirroring, the others as they are with it.
    for k, both in enumerate([True, False, True] if flip is None else [bool(flip)] * 3):
        alone = KeypointNetwork(network.path, OnnxOptions(flip=both, turn=False)).locate(crops)
        for a, b in zip(found.found, alone.found, strict=True):
            np.testing.assert_allclose(a[k], b[k], rtol=1e-4, atol=1e-3)
