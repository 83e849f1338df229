"""What is read from a finished render: pixels, depth, and labels of the person."""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from muybridge.arrays import BoolArray, ByteArray, Float32Array, FloatArray
from muybridge.train.synthesis.bodies.body_model import BODY_VERTICES
from muybridge.train.synthesis.bodies.surface_markers import markers_seen
from muybridge.train.synthesis.rendering.view import FAR, NEAR, View

# Range of a person's mean luma (0..255) after exposure.
LUMA = (45.0, 205.0)

# Depth of a landmark under the skin, in metres for a body of 1.7 m: beyond it, something hides the landmark.
_DEPTH = {
    "face": 0.06,
    "shoulder": 0.11,
    "elbow": 0.08,
    "wrist": 0.07,
    "hip": 0.17,
    "knee": 0.10,
    "foot": 0.08,
}
LANDMARK_DEPTH = np.array(
    [_DEPTH["face"]] * 5 + [_DEPTH["shoulder"]] * 2 + [_DEPTH["elbow"]] * 2 + [_DEPTH["wrist"]] * 2
    + [_DEPTH["hip"]] * 2 + [_DEPTH["knee"]] * 2 + [_DEPTH["foot"]] * 8
)  # fmt: skip


@dataclass(frozen=True)
class Render:
    """Image and labels of a person in a view.

    Attributes:
        rgba: (H, W, 4) uint8, premultiplied by alpha, which is coverage.
        shadow: (H, W) uint8, where the floor lies in the person's shadow.
        landmarks_px: (23, 2) pixels.
        visible: (23,) whether the landmark is in the image and not hidden by the person's own body.
        box_px: (4,) left, top, right, bottom of the whole body, also outside the image.
        markers_px: (M, 2) pixels of the virtual markers, in the order of `SURFACE`.
        markers_visible: (M,) whether the marker faces the camera, is in the image and not behind a limb.
        cut_px: (3,) where the person of a close-up has to be cut off, see `close_ups.Cuts`; else NaN.
    """

    rgba: ByteArray
    shadow: ByteArray
    landmarks_px: Float32Array
    visible: BoolArray
    box_px: Float32Array
    markers_px: Float32Array
    markers_visible: BoolArray
    cut_px: Float32Array = field(default_factory=lambda: np.full(3, np.nan, np.float32))


@dataclass(frozen=True, eq=False)
class Shape:
    """A posed body, ready to be drawn.

    Attributes:
        vertices: (V, 3) world metres.
        table: (count, 9) positions, normals and slack positions, see `Shells.shape`.
        normals: (count, 3) of the vertices.
        markers: (M, 3) virtual markers, world metres; `marker_normals` (M, 3).
    """

    vertices: Float32Array
    table: Float32Array
    normals: Float32Array
    markers: Float32Array
    marker_normals: Float32Array


def read_pixels(view: View, target: object) -> ByteArray:
    """(H, W, channels) or, of one channel, (H, W); row 0 is at the top."""
    channels = target.color_attachments[0].components  # type: ignore[attr-defined]
    shape = (view.height, view.width, channels) if channels > 1 else (view.height, view.width)
    data = target.read(components=channels, alignment=1)  # type: ignore[attr-defined]
    return np.frombuffer(data, "u1").reshape(shape)[::-1].copy()


def read_depth(view: View, depth: object) -> Float32Array:
    """(H, W) metres along the optical axis."""
    z = np.frombuffer(depth.read(alignment=1), "f4").reshape(view.height, view.width)[::-1]  # type: ignore[attr-defined]
    return np.asarray(2 * FAR * NEAR / (FAR + NEAR - (2 * z - 1) * (FAR - NEAR)))


def standing_height(vertices: Float32Array) -> float:
    """The longest side of a body's bounding box, metres."""
    return float(np.ptp(vertices[:BODY_VERTICES], axis=0).max())


def landmark_labels(
    view: View, shape: Shape, metres: Float32Array, landmarks_world: NDArray[np.floating]
) -> tuple[Float32Array, BoolArray, Float32Array]:
    """Pixels (23, 2) of a person's landmarks, whether they are visible, and the box (4,) of the body."""
    px, depth_m = clip_near(*view.project(landmarks_world))
    body_px = np.ascontiguousarray(view.project(shape.vertices[:BODY_VERTICES])[0].T)
    box = np.concatenate([body_px.min(1), body_px.max(1)])
    inside, surface = surface_depth(px, metres)
    height = standing_height(shape.vertices)
    visible = inside & (depth_m - surface < LANDMARK_DEPTH * min(height, 1.8) / 1.7 + 0.02)
    return px.astype(np.float32), visible, box.astype(np.float32)


def marker_labels(view: View, shape: Shape, metres: Float32Array) -> tuple[Float32Array, BoolArray]:
    """Pixels (M, 2) of a person's markers and whether they are visible."""
    px, depth_m = clip_near(*view.project(shape.markers))
    inside, surface = surface_depth(px, metres)
    eye = -view.cam_from_world[:, :3].T @ view.cam_from_world[:, 3]
    seen = markers_seen(shape.markers, shape.marker_normals, eye, depth_m, surface, standing_height(shape.vertices))
    return px.astype(np.float32), inside & seen


def expose(rgba: ByteArray, metered: BoolArray | None = None) -> ByteArray:
    """Bring the mean luma of a person, or of the `metered` pixels (H, W), into `LUMA`, in place, like a camera's
    exposure control."""
    person = rgba[..., 3] > 0 if metered is None else metered
    for _ in range(3 if person.any() else 0):
        luma = float(rgba[person, :3].mean(0) @ [0.299, 0.587, 0.114])
        wanted = float(np.clip(luma, *LUMA))
        if abs(wanted - luma) < 1:
            break
        steps, gain = np.arange(256) / 255, wanted / max(luma, 4.0)
        curve = (1 - (1 - steps) ** gain) if gain > 1 else steps * gain  # brightening keeps white white
        rgba[..., :3] = (curve.clip(0, 1) * 255).round().astype(np.uint8)[rgba[..., :3]]
    return rgba


def antialias(rgba: ByteArray) -> ByteArray:
    """Smooth the silhouette; the inside keeps its detail."""
    smooth = cv2.GaussianBlur(rgba, (3, 3), 0.65)
    cover = smooth[..., 3]
    edge = (cover > 0) & (cover < 255)
    rgba[edge] = smooth[edge]
    return rgba


def clip_near(px: FloatArray, depth_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Pixels and depths; points clipped by the near plane are moved far outside any image."""
    px[depth_m < NEAR] = -1e5
    return px, depth_m


def surface_depth(px: FloatArray, metres: NDArray[np.floating]) -> tuple[BoolArray, NDArray[np.floating]]:
    """(J,) whether `px` (J, 2) lie in the image, and the median depth of the 3 x 3 pixels around each: robust to
    aliasing at silhouettes."""
    at = np.round(px).astype(int)
    size = np.array(metres.shape[::-1])
    inside = np.all((at >= 1) & (at < size - 1), axis=1)
    x, y = at.clip(1, size - 2).T
    return np.asarray(inside), np.median([metres[y + j, x + i] for i in (-1, 0, 1) for j in (-1, 0, 1)], 0)
