"""`label.json`: confidence of each label in each frame, and all changes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge import __version__
from muybridge.geometry.markers.cleaning import Cleaned, Sample
from muybridge.infer.labelling.label import Labelled

# A label with confidence below this should be checked by a person.
DOUBTFUL = 0.6


def spans(values: NDArray[Any]) -> list[tuple[int, int, Any]]:
    """Runs of equal values of a (T,) array: first, last, value."""
    if not len(values):
        return []
    cuts = np.nonzero(values[1:] != values[:-1])[0] + 1
    edges = [0, *cuts.tolist(), len(values)]
    return [(a, b - 1, values[a].item()) for a, b in zip(edges, edges[1:], strict=False)]


def doubtful(labelled: Labelled) -> list[dict[str, Any]]:
    """Spans in which a label has low confidence, the longest first."""
    out = []
    for m, label in enumerate(labelled.markers.labels):
        unsure = np.isfinite(labelled.points[:, m, 0]) & (labelled.confidence[:, m] < DOUBTFUL)
        for a, b, bad in spans(unsure):
            if bad:
                mean = float(labelled.confidence[a : b + 1, m].mean())
                out.append({"marker": label, "frames": [a, b], "confidence": round(mean, 3)})
    return sorted(out, key=lambda d: d["frames"][0] - d["frames"][1])


def changes(labelled: Labelled, cleaned: Cleaned, names: tuple[str, ...]) -> list[dict[str, Any]]:
    """All differences from the file, in the order of frames."""
    out: list[dict[str, Any]] = []
    for m, label in enumerate(labelled.markers.labels):
        for a, b, column in spans(labelled.column[:, m]):
            if column >= 0 and names[column].split(":")[-1] != label:
                out.append({"frames": [a, b], "change": "named", "from": names[column], "to": label})
        for a, b, spike in spans(cleaned.spikes[:, m]):
            if spike:
                out.append({"frames": [a, b], "change": "spike taken out", "marker": label})
        for a, b, sample in spans(cleaned.sample[:, m]):
            if sample >= Sample.CURVE:
                error = float(np.nanmean(cleaned.error_m[a : b + 1, m])) * 1000
                out.append({"frames": [a, b], "change": "filled", "marker": label, "by": Sample(sample).name.lower(),
                            "expected_error_mm": round(error, 1)})  # fmt: skip
    nameless = (labelled.tracks.track >= 0) & (labelled.label < 0)
    t, s = np.nonzero(nameless)
    unnamed = np.zeros((len(nameless), len(names)), bool)
    unnamed[t, labelled.tracks.column[t, s]] = True
    for k in np.nonzero(unnamed.any(0))[0]:
        for a, b, dropped in spans(unnamed[:, k]):
            if dropped:
                out.append({"frames": [a, b], "change": "left unnamed", "from": names[k]})
    return sorted(out, key=lambda c: (c["frames"][0], c["change"]))


def label_json(
    labelled: Labelled, cleaned: Cleaned, names: tuple[str, ...], fps: float, source: str, notes: list[str],
    corrected: list[str], figures: dict[str, Any],
) -> dict[str, Any]:  # fmt: skip
    """The content of `label.json`; frames count from 0, spans include both ends."""
    found = np.isfinite(labelled.points[..., 0])
    markers: dict[str, Any] = {}
    mean = [float(labelled.confidence[f, m].mean()) if f.any() else 0.0 for m, f in enumerate(found.T)]
    for m, label in enumerate(labelled.markers.labels):
        sample = [[a, b, Sample(v).name.lower()] for a, b, v in spans(cleaned.sample[:, m])]
        origin = [[a, b, names[c]] for a, b, c in spans(labelled.column[:, m]) if c >= 0]
        markers[label] = {
            "body_point": labelled.markers.names[m], "found": round(float(found[:, m].mean()), 4),
            "mean_confidence": round(mean[m], 4),
            "samples": sample, "from": origin,
            "confidence": np.round(labelled.confidence[:, m], 2).tolist(),
        }  # fmt: skip
    return {
        "muybridge": __version__, "source": source, "marker_set": labelled.markers.name, "frames": len(found),
        "fps": fps, "z_up_from_file": np.round(labelled.turn).astype(int).tolist(),
        "unit_factor": labelled.factor, "notes": notes, **figures,
        "corrections": corrected, "doubtful": doubtful(labelled), "markers": markers,
        "changes": changes(labelled, cleaned, names),
    }  # fmt: skip
