"""Every kind of thing that can be built, by name."""

from collections.abc import Callable

import numpy as np

from muybridge.train.synthesis.things.built import Built
from muybridge.train.synthesis.things.objects import (
    animals,
    cars,
    cycles,
    household,
    mobility,
    music,
    seats,
    sport,
    tables,
)

Builder = Callable[[np.random.Generator], Built]


def _rollers(rng: np.random.Generator) -> Built:
    return cycles.on_rollers(rng, cycles.bicycle(rng))


def _crutch(rng: np.random.Generator) -> Built:
    return mobility.crutch(rng, rng.uniform(0.7, 0.95))


def _inside(rng: np.random.Generator) -> Built:
    return cars.car_inside(rng, rng.uniform(0.85, 1.1), rng.uniform(0.24, 0.36))


def _drum(rng: np.random.Generator) -> Built:
    return music.drum(rng, rng.uniform(0.6, 0.8))


def _piano(rng: np.random.Generator) -> Built:
    return music.piano(rng, rng.uniform(0.66, 0.8))


def _lain(kind: str) -> Builder:
    """An instrument that lies on its back or stands."""

    def build(rng: np.random.Generator) -> Built:
        made = music.fiddle(rng, kind)
        lowest = float(made.mesh.vertices[:, 1].min())
        upright = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
        return made.carried(upright, (0, 0, -lowest))

    return build


def _on_floor(build: Builder) -> Builder:
    """What is built around its handle, put on the floor."""

    def put(rng: np.random.Generator) -> Built:
        made = build(rng)
        return made.placed(0.0, (0, 0, -float(made.mesh.vertices[:, 2].min())))

    return put


# Kinds of thing. Those of the second table are what a detector takes for people, or what hides them.
USED: dict[str, Builder] = {
    "chair": seats.chair, "office chair": seats.office_chair, "stool": seats.stool, "bench": seats.bench,
    "sofa": seats.sofa, "cushion": seats.cushion, "exercise ball": seats.exercise_ball,
    "wheelchair": mobility.wheelchair, "walker": mobility.walker, "crutch": _crutch, "pram": mobility.pram,
    "table": tables.table, "counter": tables.counter, "laptop": tables.laptop, "monitor": tables.monitor,
    "keyboard": tables.keyboard, "book": tables.book, "crockery": tables.crockery,
    "treatment table": tables.treatment_table, "bed": tables.bed, "treadmill": sport.treadmill,
    "bicycle": cycles.bicycle, "bicycle on rollers": _rollers, "motorbike": cycles.motorbike,
    "horse": animals.horse, "dog": animals.dog, "barbell": _on_floor(sport.barbell),
    "dumbbell": _on_floor(sport.dumbbell), "pull-up bar": sport.pull_up_bar, "ball": _on_floor(sport.ball),
    "racket": _on_floor(sport.racket), "box": sport.carton, "tool": _on_floor(sport.tool), "guitar": _lain("guitar"),
    "violin": _lain("violin"), "cello": _lain("cello"), "drum": _drum, "piano": _piano, "car seat": _inside,
}  # fmt: skip
STANDING: dict[str, Builder] = {
    "lamp": household.lamp, "coat stand": household.coat_stand, "clothes rack": household.clothes_rack,
    "flag": household.flag, "plant": household.plant, "statue": household.statue, "door": household.door,
    "street sign": household.street_sign, "fence": household.fence, "shelf": household.shelf, "wall": household.wall,
    "hurdle": sport.hurdle, "music stand": music.music_stand, "car": cars.car, "truck": cars.truck,
}  # fmt: skip
THINGS: dict[str, Builder] = USED | STANDING
