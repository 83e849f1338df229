"""Virtual markers: surface landmarks of anny's mesh (topology anny-full), as placed in a marker-based laboratory.

Each landmark is a point of a triangle: three vertices and their weights, from `surface_markers.csv`. Names and sets are
those of `geometry.landmarks`.
"""

import csv
import functools
import pathlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, Float32Array, IndexArray
from muybridge.geometry.landmarks.marker_sets import SURFACE

Float = NDArray[np.floating]
TABLE = pathlib.Path(__file__).parent / "surface_markers.csv"
# How far behind the drawn surface a marker may lie and still count as visible: cloth over skin, metres.
CLOTH = 0.035
# A surface seen at more than about 84 degrees from its normal hides its markers.
GRAZING = 0.1


@dataclass(frozen=True)
class MarkerTable:
    """Positions of the landmarks of `SURFACE` on the mesh.

    Attributes:
        vertices: (M, 3) indices into the body's vertices.
        weights: (M, 3) barycentric, sum 1.
        tolerance_m: (M,) standard deviation of placement between examiners, metres.
    """

    vertices: IndexArray
    weights: Float32Array
    tolerance_m: Float32Array


@functools.cache
def marker_table() -> MarkerTable:
    """The table in the order of `SURFACE`."""
    with TABLE.open(newline="") as file:
        rows = {row["name"]: row for row in csv.DictReader(file)}
    ordered = [rows[name] for name in SURFACE.names]
    weights = np.array([[float(r[f"weight_{k}"]) for k in "abc"] for r in ordered])
    return MarkerTable(
        np.array([[int(r[f"vertex_{k}"]) for k in "abc"] for r in ordered], np.intp),
        (weights / weights.sum(1, keepdims=True)).astype(np.float32),
        np.array([float(r["tolerance_mm"]) / 1000 for r in ordered], np.float32),
    )


def virtual_markers(vertices: Float32Array) -> Float32Array:
    """Markers (B, M, 3) on the skin of bodies with `vertices` (B, V, 3), in the order of `SURFACE`; metres."""
    table = marker_table()
    return np.asarray(np.einsum("bmkc,mk->bmc", vertices[:, table.vertices], table.weights), np.float32)


def marker_normals(normals: Float32Array) -> Float32Array:
    """Unit normals (B, M, 3) of the skin at the markers from the vertices' `normals` (B, V, 3)."""
    mean = virtual_markers(normals)
    return np.asarray(mean / (np.linalg.norm(mean, axis=-1, keepdims=True) + 1e-12), np.float32)


def markers_seen(
    points_world: Float32Array, normals: Float32Array, eye_world: Float, depth_m: Float, front_m: Float, height_m: float
) -> BoolArray:
    """Whether markers face the camera and lie at most a garment's thickness behind the drawn surface.

    Args:
        points_world, normals: (M, 3).
        eye_world: (3,) centre of the camera, metres.
        depth_m: (M,) depth of the markers along the optical axis.
        front_m: (M,) depth of the drawn surface there.
        height_m: of the person; a child's clothes are thinner.

    Returns:
        (M,).
    """
    ray = eye_world - points_world
    ray = ray / np.linalg.norm(ray, axis=1, keepdims=True)
    facing = (ray * normals).sum(1) > GRAZING
    return np.asarray(facing & (depth_m - front_m < CLOTH * min(height_m, 1.8) / 1.7 + 0.01))
