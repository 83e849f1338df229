"""Render takes of people and things for scripts.benchmarks.takes.takes: session folders with their truth.

Usage: python -m scripts.assets.takes OUT [NAME ...]      (default: all of them)

Writes OUT/NAME/videos/cam1.mp4 ..., calibration.toml and truth.npz (`points_world` (P, T, 23, 3) metres). Existing
takes are kept. Needs the `train` extra.
"""

import pathlib
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from rich.progress import track

from muybridge.arrays import Float32Array, FloatArray
from muybridge.geometry.calibration import save_calibration
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.train.synthesis.acting.acts import ACTS
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.clothing.sample import sample_outfit
from muybridge.train.synthesis.rendering.multi_person_takes import cast, draw_people, sample_rig, view_of
from muybridge.train.synthesis.rendering.renderer import Renderer
from muybridge.train.synthesis.rendering.scene_renderer import SceneRenderer, share_light
from muybridge.train.synthesis.rendering.takes import Room, draw_scene
from muybridge.train.synthesis.rendering.view import View
from scripts.assets.write_video import video_writer


@dataclass(frozen=True)
class Plan:
    """Content of a take: `kinds` of motion, one per person; cameras and their image size; their distance from the
    centre, metres. `act`, a name of `ACTS`, is there instead of kinds of motion; `height` is where cameras look, and
    `span` what their pictures' shorter side shows there, metres."""

    kinds: tuple[str, ...]
    cameras: int = 4
    size: tuple[int, int] = (1280, 720)
    distance: float = 4.6
    fps: int = 30
    seconds: float = 4.0
    reach: float = 0.4
    seed: int = 0
    gain: float = 1.0
    noise: float = 3.0
    act: str = ""
    height: float = 0.95
    span: float = 3.0


def acted(act: str, seed: int, seconds: float, height: float, size: tuple[int, int] = (960, 540)) -> Plan:
    """A take of people with things, seen by four smaller cameras."""
    return Plan((), act=act, seed=seed, seconds=seconds, height=height, size=size, distance=4.2, span=2.3)


PLANS = {
    "walker": Plan(("walk",), seed=1),
    "dancer": Plan(("dance",), seed=2),
    "kicker-portrait": Plan(("kick",), size=(720, 1280), seed=3),
    "runner-60": Plan(("run",), fps=60, seconds=3, seed=4),
    "jumper-3-cameras": Plan(("jump",), cameras=3, seed=5),
    "floor": Plan(("get_up",), seed=6),
    "lying": Plan(("lie",), seed=107),
    "cartwheel": Plan(("cartwheel",), seed=121),
    "handstand": Plan(("handstand",), seed=131),
    "dark": Plan(("reach",), gain=0.3, noise=6.0, size=(640, 480), seed=7),
    "two-walkers": Plan(("walk", "walk"), seed=11),
    "two-close": Plan(("pair",), seed=12),
    "stand-and-walk": Plan(("stand", "walk"), seed=13, reach=0.7),
    "three": Plan(("walk", "sit", "dance"), cameras=5, seed=14, reach=1.1),
    "crowd": Plan(("walk", "walk", "stand", "squat"), cameras=6, seed=15, reach=1.2),
    "wheelchair": acted("wheelchair", 21, 4.7, 0.75),
    "therapist": acted("therapist", 22, 4.0, 0.85, (640, 480)),
    "table": acted("table", 32, 4.0, 0.75, (640, 480)),
    "cyclist": acted("cyclist", 24, 4.0, 0.95),
}

Light = tuple[float, float, float]
Draw = Callable[[View, Float32Array, int], FloatArray]  # a frame before the empty room, 0 to 255


def _moving(
    plan: Plan, body: BodyModel, renderer: Renderer, rng: np.random.Generator
) -> tuple[FloatArray, Light, Draw]:
    """People who move one by one: landmarks (P, T, 23, 3), the light, and how to draw a frame."""
    actors = cast(body, plan.kinds, plan.seconds, plan.fps, plan.reach)

    def draw(view: View, plate: Float32Array, t: int) -> FloatArray:
        return draw_people(renderer, plate, view, actors, t, rng, noise=0.0)

    return np.stack([a.landmarks for a in actors]), actors[0].outfit.light, draw


def _acting(plan: Plan, body: BodyModel, renderer: Renderer) -> tuple[FloatArray, Light, Draw]:
    """The same of people with things."""
    times = np.arange(round(plan.seconds * plan.fps)) / plan.fps
    scenes = ACTS[plan.act](body, np.random.default_rng(plan.seed), times)
    outfits = share_light([sample_outfit(body.rng, p.gender) for p in scenes[0].people])
    drawn = SceneRenderer(renderer)

    def draw(view: View, plate: Float32Array, t: int) -> FloatArray:
        return draw_scene(drawn, plate, view, scenes[t], outfits)

    points = np.stack([[p.landmarks for p in s.people] for s in scenes], 1)
    return points, outfits[0].light, draw


def make(plan: Plan, out: pathlib.Path) -> None:
    """Render one take into the folder `out`."""
    body = BodyModel(plan.seed)
    renderer, rng = Renderer(body), np.random.default_rng(plan.seed)
    points, light, draw = _acting(plan, body, renderer) if plan.act else _moving(plan, body, renderer, rng)
    group = sample_rig(rng, plan.cameras, plan.size, plan.distance, plan.height, plan.span)
    room = Room(renderer, plan.seed, half_side=plan.distance * 1.3, height=3.4)
    (out / "videos").mkdir(parents=True, exist_ok=True)
    for camera in group.cameras:
        view = view_of(camera)
        plate = room.render(view, light).astype(np.float32)
        colour = np.exp(rng.normal(0, 0.06, 3)) * np.exp(rng.normal(0, 0.12))
        frames = (
            draw(view, plate, t) * colour * plan.gain
            for t in track(range(points.shape[1]), f"{out.name} {camera.name}")
        )
        noisy = ((f + rng.normal(0, plan.noise, f.shape)).clip(0, 255).astype(np.uint8) for f in frames)
        path = out / "videos" / f"{camera.name}.mp4"
        with video_writer(path, (camera.width, camera.height), plan.fps, 24, "fast") as write:
            for image in noisy:
                write(image)
    truth = points.astype(np.float32)
    np.savez_compressed(out / "truth.npz", points_world=truth, names=np.array(BODY23.names), fps=plan.fps)
    save_calibration(group, out / "calibration.toml")  # written last: it marks a take as complete


def main() -> None:
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    out = pathlib.Path(sys.argv[1])
    for name in sys.argv[2:] or PLANS:
        if name not in PLANS:
            raise SystemExit(f"no plan called {name}; there are {', '.join(PLANS)}")
        if not (out / name / "calibration.toml").exists():
            make(PLANS[name], out / name)


if __name__ == "__main__":
    main()
