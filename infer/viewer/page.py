"""The page, and the component that other pages use: template, style, script and data in one file."""

import html
import json
from collections.abc import Mapping, Sequence
from importlib import resources
from typing import Any

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
    return page("muybridge view", title, component_style(), component(scenes, side_by_side), component_script())


def page(generator: str, title: str, style: str, component: str, script: str) -> str:
    """A page of one component, which fills the window.

    Args:
        generator: the command that makes it.
        title: as text.
        style: what its `<style>` element holds.
        component: the element, with its data.
        script: what stands in a `<script>` element behind it.
    """
    parts = {"generator": generator, "title": html.escape(title), "style": style, "component": component,
             "script": script}  # fmt: skip
    return filled("page.html", parts)


def component(scenes: Sequence[Scene], side_by_side: bool = False) -> str:
    """The element that shows some files, for any page that has `component_style` and, behind it, `component_script`."""
    data = {"takes": [scene.packed for scene in scenes], "apart": side_by_side}
    return filled("component.html", {"data": embedded_json(data)})


def component_style() -> str:
    """What stands in a `<style>` element of a page with components."""
    return read_asset("viewer.css")


def component_script() -> str:
    """What stands in a `<script>` element behind all components of a page; it leaves no name in the page."""
    return joined_scripts("maths.js", "drawing.js", "camera.js", "viewer.js")


def joined_scripts(*names: str) -> str:
    """Scripts of the package in one scope of their own."""
    script = "\n".join(read_asset(name) for name in names)
    return f"(() => {{\n{script}}})();"


def embedded_json(data: Any) -> str:
    """Data as JSON that may stand in a `<script>` element: no `</script>` or `<!--` in a name can close or open
    anything."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def filled(template: str, parts: Mapping[str, str]) -> str:
    """A template of the package with its parts put in, by the names that stand between `@@`."""
    pieces = read_asset(template).split("@@")
    return "".join(parts[piece] if k % 2 else piece for k, piece in enumerate(pieces))
