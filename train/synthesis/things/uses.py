"""Scenes of people who use things, by name; and scenes of things alone."""

from collections.abc import Callable

import numpy as np

from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.things.catalogue import STANDING, THINGS, USED
from muybridge.train.synthesis.things.scene import Scene
from muybridge.train.synthesis.things.using import leaning, lifting, lying, moving, playing, riding, sitting

# Things used alone are as likely as things that stand about.
_LYING_ABOUT = ("coat stand", "wheelchair", "clothes rack", "chair", "statue", "horse", "dog", "lamp", "flag", "plant")

USES: dict[str, Callable[[BodyModel, np.random.Generator], Scene]] = {
    "chair": sitting.seated("chair", "office chair"),
    "stool": sitting.seated("stool", "stool", "ball"),
    "bench": sitting.seated("bench", "sofa"),
    "floor cushion": sitting.floor_seat,
    "wheelchair": sitting.wheelchair_user,
    "wheelchair pushed": moving.wheelchair_pushed,
    "table": sitting.table_user(False),
    "desk": sitting.table_user(True),
    "two at a table": sitting.two_at_table,
    "bicycle": riding.cyclist,
    "bicycle on rollers": riding.cyclist_on_rollers,
    "motorbike": riding.motorcyclist,
    "horse": riding.horse_rider,
    "bed": lying.resting,
    "treatment": lying.treatment,
    "treadmill": moving.runner,
    "walker": moving.walker_user,
    "crutches": moving.crutch_user,
    "pram": moving.pram_pusher,
    "dog": moving.dog_walker,
    "box": lifting.box_lifter,
    "barbell": lifting.barbell_lifter,
    "bench press": lifting.bench_presser,
    "dumbbell": lifting.dumbbell_lifter,
    "pull-up bar": lifting.puller,
    "racket": lifting.racket_player,
    "ball": lifting.ball_player,
    "tool": lifting.tool_user,
    "guitar": playing.guitarist,
    "violin": playing.violinist,
    "cello": playing.cellist,
    "drum": playing.drummer,
    "piano": playing.pianist,
    "behind": leaning.behind,
    "leaning": leaning.leaning,
    "kneeling": leaning.kneeling,
    "car seat": leaning.driver,
}


def scene_of_things(rng: np.random.Generator) -> Scene:
    """One to four things without people: what people use, and what a detector takes for people."""
    things, edge = [], 0.0
    for _ in range(int(rng.integers(1, 5))):
        draw = rng.random()
        names = _LYING_ABOUT if draw < 0.3 else tuple(STANDING if draw < 0.65 else USED)
        made = THINGS[names[int(rng.integers(len(names)))]](rng).placed(rng.uniform(-180, 180))
        low, high = made.mesh.vertices[:, 0].min(), made.mesh.vertices[:, 0].max()
        # Beside one another, with gaps or one partly before the other.
        at = (edge - low + rng.uniform(-0.3, 0.4), rng.uniform(-0.6, 0.6), 0)
        edge = at[0] + high
        things.append(made.placed(0.0, at).thing())
    return Scene("things", (), tuple(things))
