"""What a renderer draws into one picture: people, and things around them."""

from dataclasses import dataclass

import numpy as np

from muybridge.arrays import Float32Array, IntArray


@dataclass(frozen=True, eq=False)
class Thing:
    """A mesh with a procedural surface, in the scene's world: metres, z up, the floor at z = 0.

    Attributes:
        kind: name, such as "chair".
        vertices_world: (V, 3).
        faces: (F, 3) vertex numbers, counter-clockwise from outside.
        colour: (F, 3) linear RGB, 0 to 1.
        pattern: (F,) surface: 0 plain, 1 mottled, 2 wood grain, 3 woven, 4 brushed metal, 5 fur.
        gloss: (F,) 0 matt to 1 mirror-like.
    """

    kind: str
    vertices_world: Float32Array
    faces: IntArray
    colour: Float32Array
    pattern: IntArray
    gloss: Float32Array

    def __post_init__(self) -> None:
        count = len(self.faces)
        wanted = {"colour": (count, 3), "pattern": (count,), "gloss": (count,)}
        for name, shape in wanted.items():
            if np.shape(getattr(self, name)) != shape:
                raise ValueError(f"{self.kind}: {name} must be {shape}, not {np.shape(getattr(self, name))}")


@dataclass(frozen=True, eq=False)
class Posed:
    """A person of a scene.

    Attributes:
        vertices: (V, 3) of the body model, world metres.
        landmarks: (23, 3) world metres.
        gender: 0 to 1, for clothes.
    """

    vertices: Float32Array
    landmarks: Float32Array
    gender: float


@dataclass(frozen=True, eq=False)
class Scene:
    """People and things in one world.

    Attributes:
        kind: name, such as "wheelchair" or "hug".
        people: the first is the one whom the scene is about.
        things: in any order.
    """

    kind: str
    people: tuple[Posed, ...]
    things: tuple[Thing, ...] = ()
