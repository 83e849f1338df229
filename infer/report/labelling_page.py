"""`report.html` of a labelling: what was found, how sure it is, what was changed. It opens without a network."""

from __future__ import annotations

import html
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.markers.cleaning import Cleaned, Sample
from muybridge.infer.labelling.label import Labelled
from muybridge.infer.report.labelling_facts import DOUBTFUL
from muybridge.infer.report.packing import fill_page, packed_positions, read_asset, script_json

_MOST_FRAMES = 3000
_MOST_ROWS = 60
_MOST_ORIGINS = 6
_UNSURE = 0.9


def render_label_report(labelled: Labelled, cleaned: Cleaned, content: dict[str, Any]) -> str:
    """The page as text; `content` is that of `label.json`."""
    parts = {
        "title": html.escape(f"{content['source']}: markers"), "css": read_asset("report.css"),
        "heading": _heading(content, cleaned), "doubtful": _doubtful(content), "markers": _markers(content),
        "changes": _changes(content), "data": script_json(_scene(labelled, cleaned, content)),
        "js": read_asset("label.js"),
    }  # fmt: skip
    return fill_page("label.html", parts)


def _heading(content: dict[str, Any], cleaned: Cleaned) -> str:
    sample = cleaned.sample
    tiles = [
        ("Markers", f"{content['markers_found']} of {len(content['markers'])}", "of the set were found"),
        ("Measured", f"{(sample == Sample.MEASURED).mean():.1%}", "of all samples"),
        ("Filled", f"{(sample >= Sample.CURVE).mean():.1%}", "of all samples, marked as such"),
        ("Sure", f"{content['sure']:.1%}", f"of the names are at least {_UNSURE:.0%} certain"),
        ("Doubtful", str(len(content["doubtful"])), "spans that a person should look at"),
    ]
    cells = "".join(f'<div class="tile"><dt>{n}</dt><dd class="value">{v}</dd><dd class="meaning">{w}</dd></div>'
                    for n, v, w in tiles)  # fmt: skip
    notes = [*content["notes"], *content["corrections"]]
    said = "<ul>" + "".join(f"<li>{html.escape(n)}</li>" for n in notes) + "</ul>" if notes else ""
    seconds = content["frames"] / content["fps"]
    line = (f"{content['frames']} frames at {content['fps']:g} a second ({seconds:.1f} s), marker set "
            f"{html.escape(content['marker_set'])}")  # fmt: skip
    title = html.escape(content["source"])
    return f'<header><h1>{title}</h1><p class="facts">{line}</p><dl class="tiles">{cells}</dl>{said}</header>'


def _doubtful(content: dict[str, Any]) -> str:
    rows = [
        f'<tr><td>{html.escape(d["marker"])}</td><td><button type="button" data-frame="{d["frames"][0]}">'
        f'{d["frames"][0]}–{d["frames"][1]}</button></td><td class="num">{d["confidence"]:.0%}</td></tr>'
        for d in content["doubtful"][:_MOST_ROWS]
    ]  # fmt: skip
    if not rows:
        return "<section><h2>Doubtful spans</h2><p>None: every name holds over its whole span.</p></section>"
    how = (
        "Settle them in a corrections file, a line each (frames, from, to), such as <code>100-250 LWRA LWRB</code> or "
        "<code>300-320 LTOE delete</code>; <code>--corrections FILE</code> applies it, now and in later runs."
    )
    table = _table(("Marker", "Frames", "#Confidence"), rows)
    return f'<section><h2>Doubtful spans</h2><p class="lead">{how}</p>{table}</section>'


def _markers(content: dict[str, Any]) -> str:
    rows = []
    for label, m in content["markers"].items():
        filled = sum(b - a + 1 for a, b, kind in m["samples"] if kind not in ("measured", "missing"))
        origins = list(dict.fromkeys(name for _, _, name in m["from"]))
        shown = ", ".join(origins) if len(origins) <= _MOST_ORIGINS else f"pieces of {len(origins)}"
        rows.append(
            f"<tr><td>{html.escape(label)}</td><td>{html.escape(m['body_point'].replace('_', ' '))}</td>"
            f'<td class="num">{m["found"]:.1%}</td><td class="num">{filled}</td>'
            f'<td class="num">{m["mean_confidence"]:.0%}</td><td>{html.escape(shown) or "–"}</td></tr>'
        )
    head = ("Marker", "Body point", "#Measured", "#Frames filled", "#Confidence", "Trajectories of the file")
    return f"<section><h2>Markers</h2>{_table(head, rows)}</section>"


def _table(head: tuple[str, ...], rows: list[str]) -> str:
    """A table; columns whose title begins with # hold numbers."""
    cells = "".join(f'<th class="num">{h[1:]}</th>' if h.startswith("#") else f"<th>{h}</th>" for h in head)
    return f"<table><thead><tr>{cells}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _changes(content: dict[str, Any]) -> str:
    shown = [c for c in content["changes"] if c["change"] != "named"]
    rows = []
    for c in shown[:_MOST_ROWS]:
        what = c["change"] + (f" by {c['by']}, expected within {c['expected_error_mm']} mm" if "by" in c else "")
        first, last = c["frames"]
        button = f'<button type="button" data-frame="{first}">{first}–{last}</button>'
        rows.append(f"<tr><td>{button}</td><td>{html.escape(c.get('marker') or c['from'])}</td><td>{what}</td></tr>")
    more = f"<p>{len(shown) - _MOST_ROWS} more are in label.json.</p>" if len(shown) > _MOST_ROWS else ""
    if not rows:
        return "<section><h2>Changes</h2><p>Names were given; no sample was changed.</p></section>"
    return f"<section><h2>Changes</h2>{_table(('Frames', 'Marker', 'What'), rows)}{more}</section>"


def _scene(labelled: Labelled, cleaned: Cleaned, content: dict[str, Any]) -> dict[str, Any]:
    """What the script draws: metres, Z up."""
    count = len(cleaned.points)
    stride = -(-count // _MOST_FRAMES)
    labels = labelled.markers.labels
    loose = np.where((labelled.label < 0)[..., None], labelled.tracks.points, np.nan)[::stride]
    order = np.argsort(~np.isfinite(loose[..., 0]), 1, kind="stable")
    most = max(1, int(np.isfinite(loose[..., 0]).sum(1).max(initial=0)))
    loose = np.take_along_axis(loose, order[..., None], 1)[:, :most]
    return {
        "labels": list(labels), "edges": [list(e) for e in labelled.markers.edge_indices],
        "sides": [label[0] if label[0] in "LR" else "" for label in labels], "fps": round(content["fps"], 4),
        "stride": stride, "shown": -(-count // stride), "state": _states(labelled, cleaned)[::stride],
        "points": packed_positions(cleaned.points[::stride] @ labelled.turn.T),
        "loose": packed_positions(loose @ labelled.turn.T) | {"count": most},
    }  # fmt: skip


def _states(labelled: Labelled, cleaned: Cleaned) -> list[str]:
    """A letter a marker, a word a frame: missing, sure, unsure, doubtful, filled."""
    state: NDArray[np.str_] = np.where(labelled.confidence >= _UNSURE, "s", "u")
    state = np.where(labelled.confidence < DOUBTFUL, "d", state)
    state = np.where(cleaned.sample == Sample.MISSING, "m", state)
    state = np.where(cleaned.sample >= Sample.CURVE, "f", state)
    return ["".join(row) for row in state.tolist()]
