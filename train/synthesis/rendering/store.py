"""A store of renders on disk: made once, in seeded shards, composited many times.

A shard is `renders-<number>.npz` (labels) beside `renders-<number>.npy` (pixels, memory-mapped). The label file is
written last, so a shard with labels is complete. A store made before there were virtual markers may have their labels
in `markers-<number>.npz`; without, they are NaN and hidden. Shard k of a store with seed s depends only on (s, k), on
the requested kinds of motion, and on whether they are close-ups.
"""

import functools
import pathlib
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from rich.progress import Progress

from muybridge.arrays import BoolArray, ByteArray, Float32Array, IndexArray
from muybridge.errors import SessionError
from muybridge.files import replacing
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.train.engine.process_pool import map_in_processes
from muybridge.train.synthesis.bodies.body_model import BODY_VERTICES, BodyModel
from muybridge.train.synthesis.clothing.sample import sample_outfit
from muybridge.train.synthesis.motions.sampler import MOTIONS
from muybridge.train.synthesis.rendering.close_ups import sample_close_up
from muybridge.train.synthesis.rendering.renderer import Render, Renderer
from muybridge.train.synthesis.rendering.view import View, direction_from_angles, look_at, target_of_pixel

SHARD = 256  # renders
SIZE = 256  # pixels
# Memory of a rendering process, bytes.
MEMORY = 0.9e9
# The crop spans the person's bounding box times the network's padding (1.25), plus a margin for the shadow.
SPAN = 1.25 * 1.1


def sample_view(vertices: Float32Array, rng: np.random.Generator, size: int = SIZE, span: float = SPAN) -> View:
    """A gravity-aligned view of the centre of the person's bounding box, like the virtual cameras of
    `geometry.cameras.crops`: cameras stand 1 to 8 m away, from knee height to the ceiling."""
    body = vertices[:BODY_VERTICES].astype(float)
    center = (body.min(0) + body.max(0)) / 2
    reach = float(np.linalg.norm(body - center, axis=1).max())
    azimuth = rng.uniform(0, 2 * np.pi)
    distance = reach * float(np.exp(rng.uniform(np.log(2.0), np.log(9.0))))
    steep = rng.random() < 0.1
    elevation = np.radians(rng.uniform(30, 65) if steep else rng.normal(13, 14))
    elevation = max(elevation, -np.arcsin(min(0.95, max(center[2] - 0.05, 0.02) / distance)))
    eye = center + distance * direction_from_angles(azimuth, elevation)
    middle = (size - 1) / 2
    target = center
    focal = float(size)
    for points in (body[::4], body[::4], body):  # the centre of the box moves slightly as the camera turns to it
        view = View(look_at(eye, target), focal, (middle, middle), size, size)
        px = np.ascontiguousarray(view.project(points)[0].T)
        low, high = px.min(1), px.max(1)
        focal = focal * size / (span * float((high - low).max()))
        target = target_of_pixel(view, (low + high) / 2, eye, distance)
    return View(look_at(eye, target, np.radians(rng.normal(0, 3))), float(focal), (middle, middle), size, size)


@dataclass(frozen=True)
class RenderSet:
    """Renders of one or more shards.

    Attributes:
        pixels: of each shard (SHARD, 5 or 6, SIZE, SIZE) uint8: red, green, blue, alpha, shadow and, of scenes, the
            coverage of things.
        landmarks_px: (N, 23, 2).
        visible: (N, 23).
        box_px: (N, 4).
        markers_px: (N, M, 2) virtual markers in the order of `SURFACE`; NaN if the store has no labels of them.
        markers_visible: (N, M); False if the store has no labels of them.
        cut_px: (N, 3) where the person of a close-up has to be cut off, see `close_ups.Cuts`; NaN for whole people.
        others_px: (N, 4, 4) boxes of the other people of a scene, NaN where there are fewer.
        others_visible: (N, 4) visible share of each of them.
    """

    pixels: list[ByteArray]
    landmarks_px: Float32Array  # (N, 23, 2)
    visible: BoolArray  # (N, 23)
    box_px: Float32Array  # (N, 4)
    markers_px: Float32Array = field(default_factory=lambda: np.zeros((0, len(SURFACE), 2), "f4"))  # (N, M, 2)
    markers_visible: BoolArray = field(default_factory=lambda: np.zeros((0, len(SURFACE)), bool))  # (N, M)
    cut_px: Float32Array = field(default_factory=lambda: np.zeros((0, 3), "f4"))  # (N, 3)
    others_px: Float32Array = field(default_factory=lambda: np.zeros((0, 4, 4), "f4"))  # (N, 4, 4)
    others_visible: Float32Array = field(default_factory=lambda: np.zeros((0, 4), "f4"))  # (N, 4)

    def __post_init__(self) -> None:
        if len(self.cut_px) != len(self):
            object.__setattr__(self, "cut_px", np.full((len(self), 3), np.nan, np.float32))
        if len(self.markers_px) != len(self):
            object.__setattr__(self, "markers_px", np.full((len(self), len(SURFACE), 2), np.nan, np.float32))
            object.__setattr__(self, "markers_visible", np.zeros((len(self), len(SURFACE)), bool))

        if len(self.others_px) != len(self):
            object.__setattr__(self, "others_px", np.full((len(self), 4, 4), np.nan, np.float32))
            object.__setattr__(self, "others_visible", np.zeros((len(self), 4), np.float32))

    def __len__(self) -> int:
        return len(self.landmarks_px)

    @property
    def whole(self) -> IndexArray:
        """Indices of renders of whole people."""
        return np.flatnonzero(np.isnan(self.cut_px[:, 0]))

    @property
    def close_ups(self) -> IndexArray:
        """Indices of renders of parts of people."""
        return np.flatnonzero(np.isfinite(self.cut_px[:, 0]))

    def pixels_of(self, index: int) -> ByteArray:
        """(6, SIZE, SIZE) of one render."""
        planes = np.asarray(self.pixels[index // SHARD][index % SHARD])
        return planes if len(planes) == 6 else np.concatenate([planes, np.zeros_like(planes[:1])])


def render_shard(body: BodyModel, renderer: Renderer, close_ups: bool, views_each: int = 2) -> list[Render]:
    """One shard's renders: every body in `views_each` views and outfits; only a part of it if they are `close_ups`."""
    renders: list[Render] = []
    while len(renders) < SHARD:
        batch = body.sample(32)
        for i in range(len(batch.height)):
            renderer.load(batch.vertices[i])
            for _ in range(views_each):
                close_up = sample_close_up(batch.vertices[i], body.rng, SIZE, SPAN) if close_ups else None
                view = close_up.view if close_up else sample_view(batch.vertices[i], body.rng)
                outfit = sample_outfit(body.rng, float(batch.gender[i]))
                render = renderer.render(view, outfit, batch.landmarks[i])
                renders.append(replace(render, box_px=close_up.box_px, cut_px=close_up.cut_px) if close_up else render)
    return renders[:SHARD]


def shard_path(folder: pathlib.Path, number: int) -> pathlib.Path:
    """The label file of a shard; its pixels are beside it as `.npy`."""
    return folder / f"renders-{number:05d}.npz"


def shard_numbers(folder: pathlib.Path) -> list[int]:
    """Numbers of the shards of a store."""
    return sorted(int(path.stem[-5:]) for path in folder.glob("renders-[0-9][0-9][0-9][0-9][0-9].npz"))


@dataclass
class _ShardMaker:
    """Makes shards; the body model and the renderer are created for the first one.

    Attributes:
        folder, seed, kinds, close_ups: as in `make_renders`.
    """

    folder: pathlib.Path
    seed: int
    kinds: tuple[str, ...]
    close_ups: bool

    @functools.cached_property
    def _equipment(self) -> tuple[BodyModel, Renderer]:
        body = BodyModel(self.seed)
        body.kinds = self.kinds
        return body, Renderer(body)

    def make(self, number: int) -> str:
        """Write a shard; return the name of the rendering device."""
        body, renderer = self._equipment
        body.rng = np.random.default_rng([self.seed, number])
        body.poses.rng = body.rng
        renders = render_shard(body, renderer, self.close_ups)
        path = shard_path(self.folder, number)
        pixels = np.stack([np.concatenate([r.rgba.transpose(2, 0, 1), r.shadow[None]]) for r in renders])
        labels = ("landmarks_px", "visible", "box_px", "markers_px", "markers_visible", "cut_px")
        with replacing(path.with_suffix(".npy")) as temporary:
            np.save(temporary, pixels)
        with replacing(path) as temporary:
            np.savez(temporary, **{k: np.stack([getattr(r, k) for r in renders]) for k in labels})  # type: ignore[arg-type]
        return renderer.device


def make_renders(
    folder: pathlib.Path, numbers: range, seed: int, kinds: Sequence[str] = (), close_ups: bool = False,
    processes: int = 1,
) -> None:  # fmt: skip
    """Write the shards that do not exist yet; the result does not depend on the number of processes.

    Args:
        folder: the store.
        numbers: of the shards.
        seed: random seed.
        kinds: of motion to restrict renders to; all if empty.
        close_ups: render parts of people.
        processes: number of processes.

    Raises:
        SessionError: there is no such kind of motion, or no process.
    """
    if unknown := sorted(set(kinds) - set(MOTIONS)):
        raise SessionError(f"unknown kind of motion {', '.join(unknown)}; known are {', '.join(MOTIONS)}")
    if processes < 1:
        raise SessionError(f"{processes} processes: at least one is needed to render")
    folder.mkdir(parents=True, exist_ok=True)
    missing = [n for n in numbers if not shard_path(folder, n).exists()]
    if not missing:
        return
    maker = _ShardMaker(folder, seed, tuple(kinds), close_ups)
    with Progress() as progress:
        bar = progress.add_task("rendering", total=len(missing))
        for device in map_in_processes(maker.make, missing, processes):
            progress.update(bar, advance=1, description=f"rendering on {device}")


def load_renders(folder: pathlib.Path, numbers: range | None = None) -> RenderSet:
    """All complete shards of `folder`, or those of `numbers`; pixels stay on disk until used.

    Raises:
        SessionError: a shard is damaged, or has no pixels.
    """
    paths = [shard_path(folder, n) for n in shard_numbers(folder) if numbers is None or n in numbers]
    shards = [_load_shard(path) for path in paths]
    if not shards:
        return RenderSet([], np.zeros((0, 23, 2), "f4"), np.zeros((0, 23), bool), np.zeros((0, 4), "f4"))
    labels = {key: np.concatenate([shard[key] for _, shard in shards]) for key in shards[0][1]}
    return RenderSet([pixels for pixels, _ in shards], **labels)


def _load_shard(path: pathlib.Path) -> tuple[ByteArray, dict[str, Any]]:
    """The pixels of a shard and its labels by their names in `RenderSet`."""
    try:
        with np.load(path) as file:
            labels = {key: file[key] for key in ("landmarks_px", "visible", "box_px")}
            cuts = file["cut_px"] if "cut_px" in file else np.full((SHARD, 3), np.nan, np.float32)
            others = file["others_px"] if "others_px" in file else np.full((SHARD, 4, 4), np.nan, np.float32)
            shares = file["others_visible"] if "others_visible" in file else np.zeros((SHARD, 4), np.float32)
        markers, visible = _load_markers(path)
        pixels = np.load(path.with_suffix(".npy"), mmap_mode="r")
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise SessionError(
            f"{path}: a damaged shard, or one without the pixels beside it ({error}); remove it and its .npy, and "
            "`muybridge synth` makes it again"
        ) from error
    scene = {"others_px": others, "others_visible": shares}
    return pixels, labels | {"markers_px": markers, "markers_visible": visible, "cut_px": cuts} | scene


def _load_markers(path: pathlib.Path) -> tuple[Float32Array, BoolArray]:
    """`markers_px` and `markers_visible` of a shard: its own, else from the file beside it, else NaN and False."""
    beside = path.with_name(path.name.replace("renders-", "markers-"))
    for file in (path, beside):
        labels = np.load(file) if file.exists() else {}
        if "markers_px" in labels and labels["markers_px"].shape[1] == len(SURFACE):
            return labels["markers_px"], labels["markers_visible"]
    n = len(np.load(path)["landmarks_px"])
    return np.full((n, len(SURFACE), 2), np.nan, np.float32), np.zeros((n, len(SURFACE)), bool)
