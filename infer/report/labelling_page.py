"""`report.html` of a labelling: markers found, confidence of their names, changes. It opens without a network."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.geometry.markers.cleaning import Cleaned, Sample
from muybridge.infer.labelling.label import Labelled
from muybridge.infer.report.labelling_facts import DOUBTFUL
from muybridge.infer.report.packing import packed_positions
from muybridge.infer.report.templates import page_style, render, script_json, style_or_script

_MOST_FRAMES = 3000
_MOST_ROWS = 60
_MOST_ORIGINS = 6
_UNSURE = 0.9


def render_label_report(labelled: Labelled, cleaned: Cleaned, content: dict[str, Any]) -> str:
    """The page as text.

    Args:
        labelled: named markers.
        cleaned: the same without spikes and gaps.
        content: of `label.json`.
    """
    changes = [c for c in content["changes"] if c["change"] != "named"]
    return render(
        "label.html",
        source=content["source"],
        content=content,
        fps=f"{content['fps']:g}",
        seconds=content["frames"] / content["fps"],
        tiles=_tiles(content, cleaned),
        notes=[*content["notes"], *content["corrections"]],
        doubtful=content["doubtful"][:_MOST_ROWS],
        markers=[_marker_row(label, marker) for label, marker in content["markers"].items()],
        changes=[_change_row(change) for change in changes[:_MOST_ROWS]],
        more_changes=len(changes) - _MOST_ROWS,
        css=page_style(),
        js=style_or_script("label.js"),
        data=script_json(_scene(labelled, cleaned, content)),
    )


def _tiles(content: dict[str, Any], cleaned: Cleaned) -> list[tuple[str, str, str]]:
    sample = cleaned.sample
    return [
        ("Markers", f"{content['markers_found']} of {len(content['markers'])}", "of the set were found"),
        ("Measured", f"{(sample == Sample.MEASURED).mean():.1%}", "of all samples"),
        ("Filled", f"{(sample >= Sample.CURVE).mean():.1%}", "of all samples, marked as such"),
        ("Sure", f"{content['sure']:.1%}", f"of the names are at least {_UNSURE:.0%} certain"),
        ("Doubtful", str(len(content["doubtful"])), "spans that a person should look at"),
    ]


def _marker_row(label: str, marker: dict[str, Any]) -> dict[str, Any]:
    origins = list(dict.fromkeys(name for _, _, name in marker["from"]))
    return {
        "label": label,
        "body_point": marker["body_point"],
        "found": marker["found"],
        "filled": sum(b - a + 1 for a, b, kind in marker["samples"] if kind not in ("measured", "missing")),
        "confidence": marker["mean_confidence"],
        "origins": ", ".join(origins) if len(origins) <= _MOST_ORIGINS else f"pieces of {len(origins)}",
    }


def _change_row(change: dict[str, Any]) -> dict[str, Any]:
    how = f" by {change['by']}, expected within {change['expected_error_mm']} mm" if "by" in change else ""
    marker = change.get("marker") or change["from"]
    return {"frames": change["frames"], "marker": marker, "what": change["change"] + how}


def _scene(labelled: Labelled, cleaned: Cleaned, content: dict[str, Any]) -> dict[str, Any]:
    """Data for the script: metres, Z up."""
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
    """One word per frame with one letter per marker: missing, sure, unsure, doubtful, filled."""
    state: NDArray[np.str_] = np.where(labelled.confidence >= _UNSURE, "s", "u")
    state = np.where(labelled.confidence < DOUBTFUL, "d", state)
    state = np.where(cleaned.sample == Sample.MISSING, "m", state)
    state = np.where(cleaned.sample >= Sample.CURVE, "f", state)
    return ["".join(row) for row in state.tolist()]
