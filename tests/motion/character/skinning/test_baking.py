"""Baked skinning, played as a viewer plays it."""

import numpy as np
import pytest

from muybridge.motion.character import BakeOptions, Skinner, bake
from muybridge.motion.character.skinning.skin import Skin
from tests.motion.character.skinning.tubes import hinge_frames, hinged_tube


def played(skin: Skin, baked, frames) -> np.ndarray:
    """(T, V, 3): targets added to the mesh at rest, then linear blending if it is skinned."""
    shapes = baked.positions + np.einsum("tm,mvc->tvc", baked.weights, baked.targets)
    if not baked.skinned:
        return shapes
    linear = Skinner([skin])
    return np.stack([linear.pose(frames[[t]], [shapes[t]])[0][0] for t in range(len(frames))])


@pytest.mark.parametrize("mode", ["correctives", "vertices"])
@pytest.mark.parametrize("method", ["dual-quaternion", "rotation-centres"])
def test_viewers_show_the_method_s_own_result(mode: str, method: str) -> None:
    skin = hinged_tube()
    angle = np.radians(np.linspace(0, 120, 25))[:, None]
    frames = hinge_frames(angle * [0.3, 0, 1.0])
    skinner = Skinner([skin], method)
    baked = bake(skinner, 0, frames, BakeOptions(mode=mode, tolerance=1e-3, most=12))
    error = np.linalg.norm(played(skin, baked, frames) - skinner.pose(frames)[0], axis=2).max()
    assert error <= 1e-3 and error == pytest.approx(baked.error, abs=1e-5)
    assert len(baked.targets) == len(baked.key_frames) < 12
    assert baked.skinned == (mode == "correctives")


def test_error_says_how_far_few_targets_are() -> None:
    skin, frames = hinged_tube(), hinge_frames(np.radians(np.linspace(0, 140, 15))[:, None] * [0, 0, 1.0])
    skinner = Skinner([skin], "dual-quaternion")
    baked = bake(skinner, 0, frames, BakeOptions(tolerance=1e-9, most=1))
    error = np.linalg.norm(played(skin, baked, frames) - skinner.pose(frames)[0], axis=2).max()
    assert len(baked.targets) == 1 and error == pytest.approx(baked.error, rel=1e-3) and error > 1e-3


def test_linear_blending_needs_no_corrective() -> None:
    frames = hinge_frames(np.radians([[0], [70]]) * np.array([0, 0, 1.0]))
    baked = bake(Skinner([hinged_tube()]), 0, frames)
    assert len(baked.targets) == 0 and baked.weights.shape == (2, 0) and baked.error == 0


def test_bad_options_are_named() -> None:
    with pytest.raises(ValueError, match="correctives, vertices"):
        BakeOptions(mode="cache")
    with pytest.raises(ValueError, match="at least one target"):
        BakeOptions(most=0)
    with pytest.raises(ValueError, match="no frames"):
        bake(Skinner([hinged_tube()]), 0, np.zeros((0, 2, 4, 4)))
