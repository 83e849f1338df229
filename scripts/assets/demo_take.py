"""Render the demo take: one synthetic person, four cameras, a few seconds, with its truth.

Usage: python -m scripts.assets.demo_take [OUT]      (default: infer/demo_take)

Writes videos/cam1.mp4 ... cam4.mp4, calibration.toml and truth.npz. Needs the `train` extra.
"""

import pathlib
import sys

import numpy as np
from rich.progress import track

from muybridge.geometry.calibration import save_calibration
from muybridge.geometry.cameras.camera import Camera
from muybridge.geometry.cameras.group import CameraGroup
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.clothing.sample import sample_outfit
from muybridge.train.synthesis.rendering.multi_person_takes import view_of
from muybridge.train.synthesis.rendering.renderer import Renderer
from muybridge.train.synthesis.rendering.takes import Room, choreograph, draw_frame, perform
from muybridge.train.synthesis.rendering.view import look_at
from scripts.assets.write_video import video_writer

SEED, SECONDS, FPS = 20261, 4.0, 25
WIDTH, HEIGHT, FOCAL_PX = 640, 480, 560.0


def cameras(target: np.ndarray) -> CameraGroup:
    """Four cameras around the person, on tripods of different heights, none exactly level."""
    placed = []
    tripods = [(35, 3.6, 1.3), (130, 3.9, 2.1), (215, 3.5, 1.6), (310, 4.0, 2.3)]
    for k, (azimuth, distance, height) in enumerate(tripods):
        a = np.radians(azimuth)
        center = np.array([distance * np.cos(a), distance * np.sin(a), height])
        pose = look_at(center, target, np.radians((3, -5, 2, -3)[k]))
        params = (FOCAL_PX, FOCAL_PX, (WIDTH - 1) / 2, (HEIGHT - 1) / 2)
        placed.append(Camera(f"cam{k + 1}", "PINHOLE", WIDTH, HEIGHT, params, pose))
    return CameraGroup(tuple(placed))


def main() -> None:
    out = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "infer/demo_take")
    (out / "videos").mkdir(parents=True, exist_ok=True)
    body = BodyModel(SEED)
    renderer = Renderer(body)
    batch = perform(body, choreograph(body, SECONDS, FPS))
    rng = np.random.default_rng(SEED)
    outfit = sample_outfit(rng, float(batch.gender[0]))
    group = cameras(batch.landmarks.mean((0, 1)).astype(float))
    room = Room(renderer, SEED)
    for camera in group.cameras:
        view = view_of(camera)
        plate = room.render(view, outfit.light)
        numbers = track(range(len(batch.height)), camera.name)
        with video_writer(out / "videos" / f"{camera.name}.mp4", (WIDTH, HEIGHT), FPS, 23, "slow") as write:
            for t in numbers:
                write(draw_frame(renderer, plate, view, batch, outfit, t, rng))
    save_calibration(group, out / "calibration.toml")
    np.savez_compressed(
        out / "truth.npz", points_world=batch.landmarks.astype(np.float32), names=np.array(BODY23.names), fps=FPS
    )


if __name__ == "__main__":
    main()
