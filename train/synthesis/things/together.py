"""Scenes of two to four people in contact, by kind. A new kind is a function and a row."""

from collections.abc import Callable

import numpy as np

from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.things.grapples import carry, floor_wrestle, tackle, wrestle
from muybridge.train.synthesis.things.pairs import arm_around, child_by_the_hand, crowd, dance, handshake, hug
from muybridge.train.synthesis.things.scene import Scene
from muybridge.train.synthesis.things.therapy import therapy

TOGETHER: dict[str, Callable[[BodyModel, np.random.Generator], Scene]] = {
    "hug": hug, "dance": dance, "handshake": handshake, "arm_around": arm_around, "parent_child": child_by_the_hand,
    "crowd": crowd, "wrestle": wrestle, "floor_wrestle": floor_wrestle, "tackle": tackle, "carry": carry,
    "therapy": therapy,
}  # fmt: skip
