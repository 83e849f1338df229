"""What the README shows works as it stands there."""

import re
from pathlib import Path

import numpy as np
import onnxruntime

from muybridge.geometry.landmarks import BODY23
from muybridge.models.registry import shipped_model


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
