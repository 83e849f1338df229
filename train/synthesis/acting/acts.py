"""Every scene that is acted, by name."""

from collections.abc import Callable

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.train.synthesis.acting.rollers import cyclist
from muybridge.train.synthesis.acting.table import two_at_table
from muybridge.train.synthesis.acting.treatment import therapist
from muybridge.train.synthesis.acting.wheelchair import wheelchair_user
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.things.scene import Scene

# What is acted within about 4.7 seconds, frame by frame at `times` (T,) in seconds.
ACTS: dict[str, Callable[[BodyModel, np.random.Generator, FloatArray], list[Scene]]] = {
    "wheelchair": wheelchair_user, "therapist": therapist, "table": two_at_table, "cyclist": cyclist,
}  # fmt: skip
