"""Bodies and renders that several tests of training share; they need the train extra."""

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from muybridge.errors import MissingExtraError

if TYPE_CHECKING:
    from muybridge.train.synthesis.bodies.body_model import BodyModel
    from muybridge.train.synthesis.rendering.renderer import Renderer
    from muybridge.train.synthesis.rendering.store import RenderSet


@pytest.fixture
def few_held_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trainings of keypoints are validated with 64 crops, not with 512."""
    from muybridge.train.keypoints import train

    monkeypatch.setattr(train, "held_out_batches", partial(train.held_out_batches, count=1))


@pytest.fixture(scope="module")
def body() -> "BodyModel":
    """A body model of seed 5, for one file of tests, since its random numbers are drawn from."""
    pytest.importorskip("torch")
    pytest.importorskip("anny")
    from muybridge.train.synthesis.bodies.body_model import BodyModel

    return BodyModel(5)


@pytest.fixture(scope="module")
def renderer(body: "BodyModel") -> "Renderer":
    """A renderer of that body; skipped where there is no OpenGL."""
    from muybridge.train.synthesis.rendering.renderer import Renderer

    try:
        return Renderer(body)
    except MissingExtraError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def renders(body: "BodyModel", renderer: "Renderer") -> "RenderSet":
    """A store of 24 renders in memory."""
    from muybridge.train.synthesis.clothing.sample import sample_outfit
    from muybridge.train.synthesis.rendering.store import sample_view

    body.rng = body.poses.rng = np.random.default_rng(3)
    batch = body.sample(24)
    shots = []
    for i in range(24):
        renderer.load(batch.vertices[i])
        view = sample_view(batch.vertices[i], body.rng)
        shots.append(renderer.render(view, sample_outfit(body.rng, float(batch.gender[i])), batch.landmarks[i]))
    return _stored(shots, ("landmarks_px", "visible", "box_px"))


@pytest.fixture(scope="module")
def close_ups(body: "BodyModel", renderer: "Renderer") -> "RenderSet":
    """Twelve renders of parts of people, in memory."""
    from muybridge.train.synthesis.clothing.sample import sample_outfit
    from muybridge.train.synthesis.rendering.close_ups import sample_close_up
    from muybridge.train.synthesis.rendering.store import SIZE

    body.rng = body.poses.rng = np.random.default_rng(4)
    batch = body.sample(12)
    shots = []
    for i in range(12):
        renderer.load(batch.vertices[i])
        near = sample_close_up(batch.vertices[i], body.rng, SIZE, 1.375)
        shot = renderer.render(near.view, sample_outfit(body.rng, float(batch.gender[i])), batch.landmarks[i])
        shots.append(replace(shot, box_px=near.box_px, cut_px=near.cut_px))
    return _stored(shots, ("landmarks_px", "visible", "box_px", "cut_px"))


def _stored(shots: list[Any], labels: tuple[str, ...]) -> "RenderSet":
    """Renders as a store in memory."""
    from muybridge.train.synthesis.rendering.store import RenderSet

    pixels = np.stack([np.concatenate([s.rgba.transpose(2, 0, 1), s.shadow[None]]) for s in shots])
    return RenderSet([pixels], **{k: np.stack([getattr(s, k) for s in shots]) for k in labels})
