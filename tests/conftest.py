"""What every test may use: where the repository is and where real recordings are, if there are any."""

import importlib
import importlib.util
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from types import ModuleType
from typing import Any

import av
import numpy as np
import pytest

from muybridge.arrays import ByteArray
from muybridge.geometry.calibration import save_calibration
from muybridge.infer.commands.app import run_command
from tests.paths import REPOSITORY, SHARED
from tests.rigs import ring_of_cameras

os.environ.setdefault("NUMBA_NUM_THREADS", "2")


@pytest.fixture(scope="session")
def repository() -> Path:
    """The repository's root."""
    return REPOSITORY


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder with real recordings beside the repository; the test is skipped where it is absent."""
    folder = SHARED / "data"
    if not folder.is_dir():
        pytest.skip("no real recordings beside the checkout (../shared/data)")
    return folder


def numbered_frame(number: int, width: int, height: int) -> ByteArray:
    """A frame that shows its number as eight bright or dark stripes, and a square that moves."""
    image = np.full((height, width, 3), 90, np.uint8)
    for bit in range(8):
        left, right = bit * width // 8, (bit + 1) * width // 8
        image[: height // 3, left:right] = 230 if number >> bit & 1 else 20
    x = 4 + number * 3 % (width - 16)
    image[height // 2 : height // 2 + 8, x : x + 8] = (200, 60, 40)
    return image


@pytest.fixture
def frame_number() -> Callable[[ByteArray], int]:
    """Reads the number that a frame of `make_video` shows."""

    def read(image: ByteArray) -> int:
        height, width = image.shape[:2]
        middles = [(2 * bit + 1) * width // 16 for bit in range(8)]
        row = image[: height // 3 - 2].astype(float).mean(axis=(0, 2))
        return sum(1 << bit for bit, x in enumerate(middles) if row[x] > 125)

    return read


@pytest.fixture
def make_video() -> Callable[..., Path]:
    """`make_video(path, frames=12, width=64, height=48, fps=30, ...)` writes a film of numbered frames."""

    def make(
        path: Path,
        frames: int = 12,
        width: int = 64,
        height: int = 48,
        fps: float = 30,
        codec: str = "libx264",
        pts: Sequence[int] | None = None,  # milliseconds
        options: dict[str, str] | None = None,
        muxer: dict[str, str] | None = None,
    ) -> Path:
        path.parent.mkdir(parents=True, exist_ok=True)
        with av.open(str(path), "w", options=muxer or {}) as container:
            stream = container.add_stream(codec, rate=Fraction(fps).limit_denominator(1001))
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            stream.options = options or ({"crf": "12", "preset": "veryfast"} if codec == "libx264" else {})
            stream.bit_rate = 1_000_000
            if pts is not None:
                stream.codec_context.time_base = Fraction(1, 1000)
            for number in range(frames):
                frame = av.VideoFrame.from_ndarray(numbered_frame(number, width, height), format="rgb24")
                if pts is not None:
                    frame.pts, frame.time_base = pts[number], Fraction(1, 1000)
                for packet in stream.encode(frame):
                    container.mux(packet)
            for packet in stream.encode(None):
                container.mux(packet)
        return path

    return make


@pytest.fixture
def make_session(tmp_path: Path, make_video: Callable[..., Path]) -> Callable[..., Path]:
    """`make_session(["cam1", "cam2"], ...)` writes a session folder: calibration and videos.

    `videos` names the files where they are not the cameras' names with `.mp4`; other arguments go to
    `make_video`.
    """

    def make(
        cameras: Sequence[str] = ("cam1", "cam2", "cam3"),
        videos: Sequence[str] | None = None,
        name: str = "session",
        width: int = 64,
        height: int = 48,
        **how: Any,
    ) -> Path:
        folder = tmp_path / name
        folder.mkdir()
        save_calibration(ring_of_cameras(cameras, size=(width, height)), folder / "calibration.toml")
        for video in videos if videos is not None else [f"{c}.mp4" for c in cameras]:
            make_video(folder / "videos" / video, width=width, height=height, **how)
        return folder

    return make


def first_frames_of_demo(folder: Path, frames: int) -> Path:
    """Write a session folder with the first frames of the demo's take."""
    from muybridge.infer.demo_take.take import demo_folder
    from muybridge.infer.session.probe import probe_video
    from muybridge.infer.session.video import read_chunks
    from scripts.assets.write_video import video_writer

    source = demo_folder()
    (folder / "videos").mkdir(parents=True)
    (folder / "calibration.toml").write_bytes(source.joinpath("calibration.toml").read_bytes())
    for video in source.joinpath("videos").iterdir():
        info = probe_video(Path(str(video)))
        with video_writer(folder / "videos" / video.name, (info.width, info.height), info.fps, crf=12) as write:
            for chunk in read_chunks(info, np.arange(frames)):
                for frame in chunk:
                    write(frame)
    return folder


@pytest.fixture(scope="session")
def short_demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo's take with its first 48 frames, a whole step: where not all of it is needed."""
    return first_frames_of_demo(tmp_path_factory.mktemp("short_demo") / "take", 48)


@pytest.fixture(scope="session")
def brief_demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo's take with its first 16 frames: where any motion will do."""
    return first_frames_of_demo(tmp_path_factory.mktemp("brief_demo") / "take", 16)


@pytest.fixture(scope="session")
def staged_people() -> ModuleType:
    """The module `staged_people.py`."""
    return _module(REPOSITORY / "tests" / "staged_people.py")


@pytest.fixture(scope="session")
def script() -> Callable[[str], ModuleType]:
    """One of `scripts/` as a module, by dotted name."""

    def load(name: str) -> ModuleType:
        sys.path.insert(0, str(REPOSITORY))
        try:
            return importlib.import_module(f"scripts.{name}")
        finally:
            sys.path.remove(str(REPOSITORY))

    return load


def _module(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def staged(
    staged_people: ModuleType, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., subprocess.CompletedProcess[str]]:
    """`staged("run", folder, ...)` runs the command line with a staged estimator, see `staged_people.py`.

    Keyword arguments become environment variables.
    """
    staged_people.stage(monkeypatch.setattr)

    def run(*arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
        given = [str(a) for a in arguments]
        capfd.readouterr()
        with monkeypatch.context() as context:
            for name, value in environment.items():
                context.setenv(name, value)
            try:
                code = run_command(given)
            except SystemExit as stop:
                code = int(stop.code or 0)
        said = capfd.readouterr()
        return subprocess.CompletedProcess(given, code, said.out, said.err)

    return run


@pytest.fixture(scope="session")
def gone() -> Callable[[int], bool]:
    """Whether the process of a number has ended."""

    def ended(pid: int) -> bool:
        try:
            return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
        except OSError:
            return True

    return ended


@pytest.fixture(scope="session")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A render store of bright sticks: a vertical bar whose ends and middle are the landmarks; training reads it."""
    from muybridge.train.synthesis.rendering.store import SHARD, SIZE, shard_path

    folder = tmp_path_factory.mktemp("synthetic") / "renders"
    folder.mkdir()
    rng = np.random.default_rng(0)
    for number in range(5):
        pixels = np.zeros((SHARD, 5, SIZE, SIZE), np.uint8)
        landmarks = np.zeros((SHARD, 23, 2), np.float32)
        boxes = np.zeros((SHARD, 4), np.float32)
        for i in range(SHARD):
            x, top, bottom = rng.integers(90, 160), rng.integers(20, 60), rng.integers(190, 240)
            pixels[i, :4, top:bottom, x - 12 : x + 12] = rng.integers(100, 255, 4)[:, None, None]
            pixels[i, 3, top:bottom, x - 12 : x + 12] = 255
            landmarks[i] = np.stack([np.full(23, x), np.linspace(top, bottom - 1, 23)], -1)
            boxes[i] = x - 12, top, x + 11, bottom - 1
        path = shard_path(folder, number)
        np.save(path.with_suffix(".npy"), pixels)
        np.savez(path, landmarks_px=landmarks, visible=np.ones((SHARD, 23), bool), box_px=boxes)
    return folder


@pytest.fixture(scope="session")
def change_weights() -> Callable[..., Path]:
    """Writes a network with the first of its weights that `chosen` takes changed: (from, to, chosen, change) -> to."""
    onnx = pytest.importorskip("onnx")

    def write(path: Path, to: Path, chosen: Callable[[Any], bool], change: Callable[..., Any]) -> Path:
        model = onnx.load(str(path))
        weights = next(i for i in model.graph.initializer if chosen(i))
        values = change(onnx.numpy_helper.to_array(weights))
        weights.CopyFrom(onnx.numpy_helper.from_array(values, weights.name))
        onnx.save(model, str(to))
        return to

    return write
