"""What the README shows works as it stands there."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import onnxruntime
import pytest

from muybridge.geometry.cameras.crops import crops_for_boxes
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.infer.detection.crop_pixels import extract_crops
from muybridge.infer.networks.keypoints import KeypointNetwork, OnnxOptions
from muybridge.models.shipped import shipped_model


def _blocks(path: Path, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", path.read_text(encoding="utf-8"), re.S)


def test_links_lead_somewhere(repository: Path) -> None:
    for page in (repository / "README.md", *(repository / "docs").glob("*.md")):
        for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8")):
            if not re.match(r"[a-z]+://", target):
                assert (page.parent / target).exists(), f"{page.name} links to {target}, which is not there"


def test_commands_exist(repository: Path) -> None:
    makefile = (repository / "Makefile").read_text()
    shell = "\n".join(_blocks(repository / "README.md", "sh"))
    for target in re.findall(r"^make ([\w-]+)", shell, re.M):
        assert re.search(rf"^{target}:", makefile, re.M)
    registered = (repository / "pyproject.toml").read_text()
    for command in re.findall(r"bin/muybridge (\w+)", shell):
        assert re.search(rf'^{command} = "muybridge\.', registered, re.M), command


def test_pipeline_snippet_names_what_exists(repository: Path) -> None:
    (snippet,) = [b for b in _blocks(repository / "README.md", "python") if "run_session" in b]
    compile(snippet, "README.md", "exec")
    imports = [line for line in snippet.splitlines() if line.startswith("from muybridge")]
    exec("\n".join(imports), {})


def test_network_snippet_runs(repository: Path, tmp_path: Path) -> None:
    model = shipped_model("keypoints")
    (snippet,) = [b for b in _blocks(repository / "README.md", "python") if "onnxruntime" in b]
    assert len(snippet.splitlines()) <= 10
    meta = onnxruntime.InferenceSession(str(model)).get_modelmeta().custom_metadata_map
    side = int(meta["input_size"])
    crop = np.random.default_rng(0).integers(0, 255, (side, side, 3), np.uint8)
    names: dict[str, object] = {"crop": crop}
    exec(snippet.replace('"keypoints.onnx"', repr(str(model))), names)
    pixels = np.asarray(names["pixels"])
    assert pixels.shape == (len(BODY23), 2) and names["names"] == list(BODY23.names)
    assert pixels.min() >= 0 and pixels.max() <= side - 1


@pytest.fixture
def nothing_else(tmp_path: Path) -> Path:
    """A folder of packages with onnxruntime and numpy alone."""
    folder = tmp_path / "packages"
    folder.mkdir()
    for name in ("numpy", "numpy.libs", "onnxruntime"):
        spec = importlib.util.find_spec(name.split(".")[0])
        assert spec is not None and spec.origin is not None
        installed = Path(spec.origin).parent.parent / name
        if installed.exists():  # numpy.libs is there on some systems alone
            try:
                (folder / name).symlink_to(installed, target_is_directory=True)
            except OSError as error:
                pytest.skip(f"this system makes no links to folders: {error}")
    return folder


def _person(repository: Path, side: int) -> np.ndarray:
    """A crop round the middle of the demo's first frame, where a person stands."""
    video = sorted((repository / "infer" / "demo_take" / "videos").iterdir())[0]
    with av.open(str(video)) as container:
        image = next(container.decode(video=0)).to_ndarray(format="rgb24")
    height, width = image.shape[:2]
    box = np.array([[0.3 * width, 0.15 * height, 0.7 * width, 0.95 * height]])
    return extract_crops(image, crops_for_boxes(box, side))[0]


@pytest.mark.parametrize("precision", ["fp32", "int8"])
@pytest.mark.parametrize("page", ["README.md", "docs/embedding.md"])
def test_network_snippets_need_onnxruntime_and_numpy_alone(
    repository: Path, nothing_else: Path, tmp_path: Path, page: str, precision: str
) -> None:
    snippet = next(b for b in _blocks(repository / page, "python") if "onnxruntime" in b)
    model = shipped_model("keypoints", precision)  # type: ignore[arg-type]
    side = KeypointNetwork(model).card.input_size
    crop = _person(repository, side)
    np.save(tmp_path / "crop.npy", crop)
    (tmp_path / "keypoints.onnx").write_bytes(model.read_bytes())
    calls = "found = find_landmarks(onnxruntime.InferenceSession('keypoints.onnx'), crop)\nimport numpy"
    ends = "pixels = numpy.array([value[:2] for value in found.values()])\nnames = list(found)"
    program = "\n".join([
        "import sys", f"sys.path.append({str(nothing_else)!r})", "import importlib.util",
        "for name in ('muybridge', 'torch', 'cv2', 'scipy', 'onnx'):",
        "    assert importlib.util.find_spec(name) is None, name",
        "import numpy; crop = numpy.load('crop.npy')",
        snippet, *([calls, ends] if "embedding" in page else []),
        "numpy.save('pixels.npy', pixels); print(' '.join(names))",
    ])  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == list(BODY23.names)
    ours = KeypointNetwork(model, OnnxOptions(flip=False, turn=False)).locate(crop[None]).found.points_crop_px[0]
    away = np.linalg.norm(np.load(tmp_path / "pixels.npy") - ours, axis=1)
    # The README's takes the best cell (4 px), the guide's refines it.
    assert np.median(away) < (3.0 if page == "README.md" else 0.7)
