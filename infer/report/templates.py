"""Pages from Jinja2 templates. Everything that is filled in is escaped, except styles, scripts and JSON of our own."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from muybridge.infer.runtime.wording import readable

if TYPE_CHECKING:
    from jinja2 import Environment

# The colours of people's left and right wherever they are drawn: in pages, and in overlays (those for dark ground).
# Orange and sky blue of Okabe and Ito's palette are distinct for all types of colour vision.
SIDES_ON_LIGHT = {"left": "#c65f00", "right": "#0072b2"}
SIDES_ON_DARK = {"left": "#ffa23a", "right": "#5cbcff"}


# Error at the person at which a cell's tint is full, millimetres.
_FULL_TINT_MM = 60.0


def read_asset(name: str) -> str:
    """A template, style or script of the package."""
    return resources.files("muybridge.infer.report").joinpath("assets", name).read_text(encoding="utf-8")


def render(template: str, **values: Any) -> str:
    """A page.

    Args:
        template: its name in `assets/`.
        values: what the template asks for; strings are escaped.

    Raises:
        jinja2.UndefinedError: the template asks for something else.
    """
    return _environment().get_template(template).render(values)


def page_style() -> Markup:
    """The style of every page, with the colours of the two sides as `--left` and `--right`, and as `--left-on-dark` and
    `--right-on-dark` for canvases that are dark on any page."""

    def sides(colours: Mapping[str, str], ending: str = "") -> str:
        return " ".join(f"--{side}{ending}: {colour};" for side, colour in colours.items())

    light = f":root {{ {sides(SIDES_ON_LIGHT)} {sides(SIDES_ON_DARK, '-on-dark')} }}"
    dark = f':root:not([data-theme="light"]) {{ {sides(SIDES_ON_DARK)} }}'
    return Markup("\n".join([light, f"@media (prefers-color-scheme: dark) {{ {dark} }}", read_asset("report.css")]))


def style_or_script(*names: str) -> Markup:
    """Assets to stand in a `<style>` or `<script>` element as they are."""
    return Markup("\n".join(read_asset(name) for name in names))


def script_json(value: object) -> Markup:
    """JSON to stand inside a script element: no `</script>` or `<!--` can close or open anything."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c"))


@functools.cache
def _environment() -> Environment:
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    made = Environment(
        loader=FunctionLoader(read_asset), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    made.filters |= {"fixed": _fixed, "readable": readable, "pretty": _pretty, "tint": tint_percent}
    made.tests["finite"] = _is_finite
    return made


def tint_percent(error_mm: float) -> float:
    """How strongly a cell is tinted for an error at the person: 0 at 0 mm, 100 at 60 mm and above."""
    return 100.0 * min(max(error_mm, 0.0) / _FULL_TINT_MM, 1.0) if np.isfinite(error_mm) else 0.0


def _fixed(value: float, digits: int = 1, sign: str = "") -> str:
    return f"{value:{sign}.{digits}f}"


def _is_finite(value: float) -> bool:
    return bool(np.isfinite(value))


def _pretty(value: object) -> str:
    return json.dumps(value, indent=2, default=str, ensure_ascii=False)
