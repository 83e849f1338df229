"""The web page in which a character is seen moving, written beside its file."""

import json
from collections.abc import Sequence
from pathlib import Path

from muybridge.errors import MuybridgeError
from muybridge.files import replacing
from muybridge.infer.viewer import Scene, read_scene, render_page
from muybridge.motion.formats.registry import ReadOptions

# A page with a larger character opens slowly or not at all.
MOST_BYTES = 30_000_000
PAGE_SUFFIXES = (".html", ".htm")


def check_page(page: Path) -> None:
    """MuybridgeError where a web page would be written under a name that no browser opens."""
    if page.is_dir():
        raise MuybridgeError(f"{page}: is a folder", remedy="other_name")
    if page.suffix.lower() not in PAGE_SUFFIXES:
        raise MuybridgeError(f"{page}: a web page ends in .html", remedy="other_name")


def fits_page(scene: Scene) -> bool:
    """Whether a character is small enough for a page."""
    return len(json.dumps(scene.packed)) <= MOST_BYTES


def write_character_page(page: Path, shown: Path, out: Path, clips: Sequence[str]) -> list[str]:
    """Write the page of a character, with all its clips beside each other.

    Args:
        page: file to write.
        shown: the character's file, of a format that the page reads.
        out: the file that the page is about, which may be of another format.
        clips: names of the clips; none for the character at rest.

    Returns:
        What was left out, one sentence each.

    Raises:
        OutputError: the page cannot be written.
    """
    scenes: list[Scene] = []
    size, left_out = 0, []
    for clip in clips or (None,):
        scene = read_scene(shown, ReadOptions(clip=clip))
        size += len(json.dumps(scene.packed))
        if scenes and size > MOST_BYTES:
            left_out.append(str(clip))
            continue
        scene.packed["name"] = out.name if len(clips) < 2 else str(clip)
        scenes.append(scene)
    with replacing(page) as temporary:
        temporary.write_text(render_page(scenes, side_by_side=len(scenes) > 1), encoding="utf-8")
    if not left_out:
        return []
    return [f"{page.name}: would be too large with {', '.join(left_out)}, so it shows {len(scenes)} of {len(clips)} "
            f"takes; `muybridge view {out.name} --clip {left_out[0]}` shows another one"]  # fmt: skip
