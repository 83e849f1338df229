"""The page: template, style, script and data in one file."""

import html
import json
from collections.abc import Sequence
from importlib import resources

from muybridge.infer.viewer.data import Scene


def read_asset(name: str) -> str:
    """A template, style or script of the package."""
    return resources.files("muybridge.infer.viewer").joinpath("assets", name).read_text(encoding="utf-8")


def render_page(scenes: Sequence[Scene], side_by_side: bool = False) -> str:
    """The page that shows some files.

    Args:
        scenes: what they hold.
        side_by_side: whether the page begins with them beside each other rather than in one place.
    """
    title = ", ".join(scene.packed["name"] for scene in scenes)
    data = {"takes": [scene.packed for scene in scenes], "apart": side_by_side}
    # No `</script>` or `<!--` in a name can close or open anything.
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    script = "\n".join(read_asset(name) for name in ("maths.js", "drawing.js", "viewer.js"))
    parts = {"title": html.escape(title), "style": read_asset("viewer.css"), "data": text, "script": script}
    pieces = read_asset("viewer.html").split("@@")
    return "".join(parts[piece] if k % 2 else piece for k, piece in enumerate(pieces))
