"""Shards of scenes: who and what is in them, and from where each is seen."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from muybridge.arrays import Float32Array, FloatArray
from muybridge.errors import SessionError
from muybridge.train.synthesis.bodies.body_model import BODY_VERTICES, BodyModel
from muybridge.train.synthesis.clothing.sample import sample_outfit
from muybridge.train.synthesis.rendering.framing import SIZE, SPAN, sample_view
from muybridge.train.synthesis.rendering.scene_renderer import SceneRender, SceneRenderer
from muybridge.train.synthesis.rendering.view import View
from muybridge.train.synthesis.things.scene import Posed, Scene
from muybridge.train.synthesis.things.together import TOGETHER
from muybridge.train.synthesis.things.uses import USES, scene_of_things

Maker = Callable[[BodyModel, np.random.Generator], Scene]

VIEWS = (2, 4)  # of a scene: least, and most + 1
UNUSUAL = 0.3  # share of views from steeply above, from the floor, and from near
UNUSUAL_ALONE = 0.7  # the same of people alone, of whom there are enough other renders
_TRIES = 12  # views of a scene before one with fewer visible landmarks is kept
_LEAST_SEEN = 5  # landmarks
_CLEARANCE = 0.3  # metres between the camera and everything
_CELL = 0.06  # metres
_CHOICE = 3  # views among which one with a hidden person is preferred
_TOO_HIDDEN = 0.85  # share of a body


def _alone(body: BodyModel, rng: np.random.Generator) -> Scene:
    """A person alone, as the other shards show them."""
    batch = body.sample(1)
    return Scene("alone", (Posed(batch.vertices[0], batch.landmarks[0], float(batch.gender[0])),))


def _things(body: BodyModel, rng: np.random.Generator) -> Scene:
    """Things without anybody, which a detector has to leave alone."""
    return scene_of_things(rng)


# Groups of kinds of scene with their shares in a store that has all of them.
GROUPS: dict[str, tuple[float, dict[str, Maker]]] = {
    "using": (0.45, dict(USES)),
    "together": (0.35, dict(TOGETHER)),
    "alone": (0.12, {"alone": _alone}),
    "things": (0.08, {"things": _things}),
}


def scene_kinds(names: Sequence[str]) -> tuple[str, ...]:
    """The kinds of scene that `names` stand for: kinds, groups of kinds, or `all`.

    Raises:
        SessionError: there is no such kind.
    """
    known = {kind for _, kinds in GROUPS.values() for kind in kinds}
    if unknown := sorted(set(names) - known - set(GROUPS) - {"all"}):
        raise SessionError(
            f"unknown kind of scene {', '.join(unknown)}; known are all, {', '.join(GROUPS)}, "
            f"{', '.join(sorted(known - set(GROUPS)))}"
        )
    return tuple(
        kind for group, (_, kinds) in GROUPS.items() for kind in kinds if {kind, group, "all"} & set(names)
    )  # fmt: skip


def render_scenes(body: BodyModel, scenes: SceneRenderer, kinds: Sequence[str], count: int) -> list[SceneRender]:
    """`count` renders of scenes of `kinds`, each scene in `VIEWS` views and outfits."""
    rng, renders = body.rng, list[SceneRender]()
    groups = [(share, [(k, make) for k, make in of.items() if k in kinds]) for share, of in GROUPS.values()]
    groups = [(share, of) for share, of in groups if of]
    shares = np.array([share for share, _ in groups])
    while len(renders) < count:
        _, makers = groups[int(rng.choice(len(groups), p=shares / shares.sum()))]
        _, make = makers[int(rng.integers(len(makers)))]
        scenes.load(make(body, rng))
        renders += [render_view(scenes, rng) for _ in range(int(rng.integers(*VIEWS)))]
    return renders[:count]


def render_view(scenes: SceneRenderer, rng: np.random.Generator) -> SceneRender:
    """A view of the loaded scene in random outfits: of somebody in it, rather of who is hidden, or of its things."""
    scene = scenes.scene
    outfits = [sample_outfit(rng, p.gender) for p in scene.people] or [sample_outfit(rng, 0.0)]
    best: SceneRender | None = None
    for _ in range(_TRIES):
        subject, view = choose_view(scene, rng)
        render = replace(scenes.render(view, outfits, subject), kind=scene.kind)
        if best is None or render.visible.sum() > best.visible.sum():
            best = render
        if not scene.people or best.visible.sum() >= _LEAST_SEEN:
            break
    assert best is not None
    return best


def clear_view(scene: Scene, subject: int, rng: np.random.Generator) -> View:
    """A view of a person of the scene, or of its things, from a place away from everything."""
    things = [t.vertices_world for t in scene.things]
    if scene.people:
        framed = scene.people[subject].vertices
    else:
        framed = np.concatenate(things)
        framed = framed[:: -(-len(framed) // BODY_VERTICES)]
    near = np.concatenate([p.vertices[:BODY_VERTICES:8] for p in scene.people] + [t[::2] for t in things])
    unusual = UNUSUAL_ALONE if scene.kind == "alone" else UNUSUAL
    for _ in range(_TRIES):
        view = sample_view(framed, rng, SIZE, SPAN, unusual)
        eye = -view.cam_from_world[:, :3].T @ view.cam_from_world[:, 3]
        inside = any((eye > t.min(0)).all() and (eye < t.max(0)).all() for t in things)
        if not inside and np.linalg.norm(near - eye, axis=1).min() > _CLEARANCE:
            break
    return view


def choose_view(scene: Scene, rng: np.random.Generator) -> tuple[int, View]:
    """Number of a person and a view of that one, with a preference for those who are more hidden there."""
    count = max(len(scene.people), 1)
    subjects = rng.integers(count, size=_CHOICE if count > 1 else 1)
    views = [clear_view(scene, int(k), rng) for k in subjects]
    if count == 1:
        return 0, views[0]
    bodies = [p.vertices[:BODY_VERTICES:6] for p in scene.people]
    hidden = np.array([hidden_shares(bodies, v)[k] for k, v in zip(subjects, views, strict=True)])
    weights = np.where(hidden < _TOO_HIDDEN, 0.15 + hidden, 0.02)
    chosen = int(rng.choice(len(views), p=weights / weights.sum()))
    return int(subjects[chosen]), views[chosen]


def hidden_shares(people: Sequence[Float32Array], view: View) -> FloatArray:
    """(N,) share of each of `people` (V, 3) whom others hide from a distant camera in the direction of `view`."""
    right, down, ahead = view.cam_from_world[:, :3]
    points = np.concatenate(people)
    whose = np.repeat(np.arange(len(people)), [len(p) for p in people])
    cells = np.stack([points @ right, points @ down], -1) / _CELL
    cells = (cells - cells.min(0)).astype(np.intp)
    nearest = np.full((*(cells.max(0) + 1), len(people)), np.inf)
    np.minimum.at(nearest, (*cells.T, whose), points @ ahead)
    behind = np.isfinite(nearest) & (nearest > nearest.min(-1, keepdims=True))
    return np.asarray(behind.sum((0, 1)) / np.isfinite(nearest).sum((0, 1)))
