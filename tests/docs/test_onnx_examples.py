"""The examples that embed a network need onnxruntime and numpy alone, and find what muybridge finds."""

import importlib.util
import json
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

SHORT, LONG = "01_landmarks_with_onnxruntime.py", "02_landmarks_with_uncertainty.py"


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
                pytest.skip(f"this system cannot link folders: {error}")
    return folder


def _person(repository: Path, side: int) -> np.ndarray:
    """A crop around the middle of the demo's first frame, where a person stands."""
    video = sorted((repository / "infer" / "demo_take" / "videos").iterdir())[0]
    with av.open(str(video)) as container:
        image = next(container.decode(video=0)).to_ndarray(format="rgb24")
    height, width = image.shape[:2]
    box = np.array([[0.3 * width, 0.15 * height, 0.7 * width, 0.95 * height]])
    return extract_crops(image, crops_for_boxes(box, side))[0]


@pytest.mark.parametrize("precision", ["fp32", "int8"])
@pytest.mark.parametrize("example", [SHORT, LONG])
def test_network_examples_need_onnxruntime_and_numpy_alone(
    repository: Path, nothing_else: Path, tmp_path: Path, example: str, precision: str
) -> None:
    model = shipped_model("keypoints", precision)  # type: ignore[arg-type]
    crop = _person(repository, KeypointNetwork(model).card.input_size)
    np.save(tmp_path / "crop.npy", crop)
    (tmp_path / "keypoints.onnx").write_bytes(model.read_bytes())
    program = "\n".join([
        "import importlib.util, runpy, sys", f"sys.path.append({str(nothing_else)!r})",
        "for name in ('muybridge', 'torch', 'cv2', 'scipy', 'onnx'):",
        "    assert importlib.util.find_spec(name) is None, name",
        "sys.argv[1:] = ['keypoints.onnx', 'crop.npy']",
        f"runpy.run_path({str(repository / 'docs' / 'examples' / example)!r}, run_name='__main__')",
    ])  # fmt: skip
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", program], cwd=tmp_path, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    rows = [line.split() for line in done.stdout.splitlines()]
    assert [row[0] for row in rows] == list(BODY23.names)
    found = np.array([[float(value) for value in row[1:]] for row in rows])
    ours = KeypointNetwork(model, OnnxOptions(flip=False, turn=False)).locate(crop[None]).found.points_crop_px[0]
    away = np.linalg.norm(found[:, :2] - ours, axis=1)
    # The short one takes the best cell (4 px), the other refines it.
    assert np.median(away) < (3.0 if example == SHORT else 0.7)
    assert (found[:, 2:] > 0).all()


def test_the_short_example_is_eleven_lines_at_most(repository: Path) -> None:
    text = (repository / "docs" / "examples" / SHORT).read_text()
    snippet = text.split("[start:snippet]\n")[1].split("# --8<-- [end")[0]
    assert len([line for line in snippet.splitlines() if line]) <= 11


def test_shipped_metadata_is_what_the_reference_names(repository: Path) -> None:
    page = (repository / "docs" / "reference" / "model-files.md").read_text()
    for kind in ("keypoints", "people"):
        session = onnxruntime.InferenceSession(str(shipped_model(kind)))  # type: ignore[arg-type]
        meta = session.get_modelmeta().custom_metadata_map
        undocumented = [key for key in meta if f"`{key}`" not in page]
        assert not undocumented, f"{kind}: {undocumented}"
        if "variance" in meta:
            factors = set(json.loads(meta["variance"])) - {"scale", "floor_px2", "knots"}
            assert not [name for name in factors if f"`{name}`" not in page]
