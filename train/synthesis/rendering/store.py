"""A store of renders on disk: made once, in seeded shards, composited many times.

A shard is `renders-<number>.npz` (labels) beside `renders-<number>.npy` (pixels, memory-mapped). The label file is
written last, so a shard with labels is complete. A store made before there were virtual markers may have their labels
in `markers-<number>.npz`; without, they are NaN and hidden. Shard k of a store with seed s depends only on (s, k), on
the requested kinds of motion or of scene, and on whether they are close-ups.
"""

import functools
import pathlib
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.progress import Progress

from muybridge.arrays import BoolArray, ByteArray, Float32Array, IndexArray
from muybridge.errors import SessionError
from muybridge.files import replacing
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.train.engine.process_pool import map_in_processes
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.clothing.sample import sample_outfit
from muybridge.train.synthesis.motions.sampler import MOTIONS
from muybridge.train.synthesis.rendering.close_ups import sample_close_up
from muybridge.train.synthesis.rendering.framing import SIZE, SPAN, sample_view
from muybridge.train.synthesis.rendering.labels import Render
from muybridge.train.synthesis.rendering.renderer import Renderer
from muybridge.train.synthesis.rendering.scene_renderer import OTHERS, SceneRenderer
from muybridge.train.synthesis.rendering.scene_shards import render_scenes, scene_kinds

SHARD = 256  # renders
CHANNELS = 6  # of pixels; shards without things have one less
_LABELS = ("landmarks_px", "visible", "box_px", "markers_px", "markers_visible", "cut_px")
_SCENE_LABELS = ("others_px", "others_visible", "kind")
# Memory of a rendering process, bytes.
MEMORY = 0.9e9


@dataclass(frozen=True)
class RenderSet:
    """Renders of one or more shards.

    Attributes:
        pixels: of each shard (SHARD, 5 or 6, SIZE, SIZE) uint8: red, green, blue, alpha, shadow, and in shards of
            scenes the share that is a thing.
        landmarks_px: (N, 23, 2).
        visible: (N, 23).
        box_px: (N, 4).
        markers_px: (N, M, 2) virtual markers in the order of `SURFACE`; NaN if the store has no labels of them.
        markers_visible: (N, M); False if the store has no labels of them.
        cut_px: (N, 3) where the person of a close-up has to be cut off, see `close_ups.Cuts`; NaN for whole people.
        others_px: (N, 4, 4) boxes of other people in the render, see `scene_renderer.SceneRender`; NaN where none is.
        others_visible: (N, 4) share of each that is visible; 0 where there is nobody.
        kind: (N,) of scene, empty for a person alone. Renders of things without people are of the kind `things`; their
            landmarks and boxes are NaN.
    """

    pixels: list[ByteArray]
    landmarks_px: Float32Array  # (N, 23, 2)
    visible: BoolArray  # (N, 23)
    box_px: Float32Array  # (N, 4)
    markers_px: Float32Array = field(default_factory=lambda: np.zeros((0, len(SURFACE), 2), "f4"))  # (N, M, 2)
    markers_visible: BoolArray = field(default_factory=lambda: np.zeros((0, len(SURFACE)), bool))  # (N, M)
    cut_px: Float32Array = field(default_factory=lambda: np.zeros((0, 3), "f4"))  # (N, 3)
    others_px: Float32Array = field(default_factory=lambda: np.zeros((0, OTHERS, 4), "f4"))  # (N, 4, 4)
    others_visible: Float32Array = field(default_factory=lambda: np.zeros((0, OTHERS), "f4"))  # (N, 4)
    kind: NDArray[np.str_] = field(default_factory=lambda: np.zeros(0, "U1"))  # (N,)

    def __post_init__(self) -> None:
        for name, empty in _absent(len(self)).items():
            if len(getattr(self, name)) != len(self):
                object.__setattr__(self, name, empty)

    def __len__(self) -> int:
        return len(self.landmarks_px)

    @property
    def whole(self) -> IndexArray:
        """Indices of renders of whole people."""
        return np.flatnonzero(np.isnan(self.cut_px[:, 0]) & np.isfinite(self.box_px[:, 0]))

    @property
    def unattended(self) -> IndexArray:
        """Indices of renders of things without people."""
        return np.flatnonzero(np.isnan(self.box_px[:, 0]))

    @property
    def close_ups(self) -> IndexArray:
        """Indices of renders of parts of people."""
        return np.flatnonzero(np.isfinite(self.cut_px[:, 0]))

    def pixels_of(self, index: int) -> ByteArray:
        """(6, SIZE, SIZE) of one render: red, green, blue, alpha, shadow, share that is a thing."""
        planes = self.pixels[index // SHARD][index % SHARD]
        if len(planes) == CHANNELS:
            return np.asarray(planes)
        return np.concatenate([planes, np.zeros((CHANNELS - len(planes), *planes.shape[1:]), np.uint8)])


def _absent(n: int) -> dict[str, Any]:
    """Labels of `n` renders that a store may lack."""
    return {
        "markers_px": np.full((n, len(SURFACE), 2), np.nan, np.float32),
        "markers_visible": np.zeros((n, len(SURFACE)), bool), "cut_px": np.full((n, 3), np.nan, np.float32),
        "others_px": np.full((n, OTHERS, 4), np.nan, np.float32),
        "others_visible": np.zeros((n, OTHERS), np.float32), "kind": np.full(n, "", "U1"),
    }  # fmt: skip


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
        folder, seed, kinds, close_ups, scenes: as in `make_renders`.
    """

    folder: pathlib.Path
    seed: int
    kinds: tuple[str, ...]
    close_ups: bool
    scenes: tuple[str, ...]

    @functools.cached_property
    def _equipment(self) -> tuple[BodyModel, Renderer]:
        body = BodyModel(self.seed)
        body.kinds = self.kinds
        return body, Renderer(body)

    @functools.cached_property
    def _scene_renderer(self) -> SceneRenderer:
        return SceneRenderer(self._equipment[1])

    def make(self, number: int) -> str:
        """Write a shard; return the name of the rendering device."""
        body, renderer = self._equipment
        body.rng = np.random.default_rng([self.seed, number])
        body.poses.rng = body.rng
        path = shard_path(self.folder, number)
        if self.scenes:
            scenes = render_scenes(body, self._scene_renderer, self.scenes, SHARD)
            _write(
                path, [np.concatenate([_planes(r), r.things[None]]) for r in scenes], scenes, _LABELS + _SCENE_LABELS
            )
        else:
            renders = render_shard(body, renderer, self.close_ups)
            _write(path, [_planes(r) for r in renders], renders, _LABELS)
        return renderer.device


def _planes(render: Render) -> ByteArray:
    return np.concatenate([render.rgba.transpose(2, 0, 1), render.shadow[None]])


def _write(path: pathlib.Path, pixels: list[ByteArray], renders: Sequence[Render], labels: Sequence[str]) -> None:
    with replacing(path.with_suffix(".npy")) as temporary:
        np.save(temporary, np.stack(pixels))
    with replacing(path) as temporary:
        np.savez(temporary, **{k: np.stack([getattr(r, k) for r in renders]) for k in labels})  # type: ignore[arg-type]


def make_renders(
    folder: pathlib.Path, numbers: range, seed: int, kinds: Sequence[str] = (), close_ups: bool = False,
    processes: int = 1, scenes: Sequence[str] = (),
) -> None:  # fmt: skip
    """Write the shards that do not exist yet; the result does not depend on the number of processes.

    Args:
        folder: the store.
        numbers: of the shards.
        seed: random seed.
        kinds: of motion to restrict renders to; all if empty.
        close_ups: render parts of people.
        processes: number of processes.
        scenes: kinds of scenes of people and things to render, or groups of them, see `scene_shards.scene_kinds`;
            people alone if empty.

    Raises:
        SessionError: there is no such kind of motion or of scene, or no process.
    """
    chosen = scene_kinds(scenes)
    if scenes and (close_ups or kinds):
        raise SessionError("scenes of people and things have neither kinds of motion nor close-ups")
    if unknown := sorted(set(kinds) - set(MOTIONS)):
        raise SessionError(f"unknown kind of motion {', '.join(unknown)}; known are {', '.join(MOTIONS)}")
    if processes < 1:
        raise SessionError(f"{processes} processes: at least one is needed to render")
    folder.mkdir(parents=True, exist_ok=True)
    missing = [n for n in numbers if not shard_path(folder, n).exists()]
    if not missing:
        return
    maker = _ShardMaker(folder, seed, tuple(kinds), close_ups, chosen)
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
            labels |= {k: file.get(k, v) for k, v in _absent(len(labels["box_px"])).items()}
        markers, visible = _load_markers(path)
        pixels = np.load(path.with_suffix(".npy"), mmap_mode="r")
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise SessionError(
            f"{path}: a damaged shard, or one without the pixels beside it ({error}); remove it and its .npy, and "
            "`muybridge synth` makes it again"
        ) from error
    return pixels, labels | {"markers_px": markers, "markers_visible": visible}


def _load_markers(path: pathlib.Path) -> tuple[Float32Array, BoolArray]:
    """`markers_px` and `markers_visible` of a shard: its own, else from the file beside it, else NaN and False."""
    beside = path.with_name(path.name.replace("renders-", "markers-"))
    for file in (path, beside):
        labels = np.load(file) if file.exists() else {}
        if "markers_px" in labels and labels["markers_px"].shape[1] == len(SURFACE):
            return labels["markers_px"], labels["markers_visible"]
    n = len(np.load(path)["landmarks_px"])
    return np.full((n, len(SURFACE), 2), np.nan, np.float32), np.zeros((n, len(SURFACE)), bool)
