"""Draw docs/assets/markers.webp: the average adult from the front, the left and the back with every virtual marker; and
update the table of docs/reference/landmarks.md below its last heading.

Usage: python -m scripts.assets.marker_picture
"""

import csv
import dataclasses
import pathlib

import cv2
import numpy as np

from muybridge.arrays import ByteArray, Float32Array, FloatArray
from muybridge.geometry.landmarks.marker_sets import SURFACE
from muybridge.train.synthesis.bodies.body_model import BodyModel
from muybridge.train.synthesis.bodies.surface_markers import TABLE
from muybridge.train.synthesis.clothing.sample import Outfit, bare_outfit
from muybridge.train.synthesis.rendering.renderer import Renderer
from muybridge.train.synthesis.rendering.view import View, look_at

DOCS = pathlib.Path(__file__).parents[2] / "docs"
# Centre (metres), width (metres), direction to the camera, height and width (pixels), and which markers: all, or
# those with one of these words in their names.
FOOT = ("left_malleolus", "left_heel", "left_toe", "left_metatarsal", "left_hallux")
PANELS = (
    ((0.0, 0.0, 0.92), 1.95, (0, -1, 0), (1000, 720), ("",)),
    ((0.0, 0.0, 0.92), 1.95, (1, 0, 0), (1000, 720), ("left", "7", "10", "sacrum", "xiph", "notch")),
    ((0.0, 0.0, 0.92), 1.95, (0, 1, 0), (1000, 720), ("",)),
    ((0.55, -0.23, 1.09), 0.30, (0.72, 0.0, 0.70), (540, 540), ("left_radial", "left_ulnar", "left_metacarpal")),
    ((0.16, -0.03, 0.50), 0.34, (-0.35, -0.94, 0.0), (540, 540), ("left_knee", "left_patella", "left_tibial")),
    ((0.2, -0.07, 0.08), 0.38, (1, -0.35, 0.35), (540, 540), FOOT),
    ((0.2, -0.07, 0.08), 0.38, (-1, -0.35, 0.35), (540, 540), FOOT),
)  # fmt: skip
PAPER, INK = (246, 246, 247), (60, 55, 51)
COLOURS = {"left": (70, 150, 40), "right": (60, 60, 220), "middle": (20, 150, 220)}  # BGR
TABLE_HEAD = "### All markers\n"


def plain_outfit() -> Outfit:
    """Bare skin in even light."""
    outfit = bare_outfit(np.random.default_rng(0))
    values = outfit.values | {
        "bodily": 0.0, "fill_colour": (0.0, 0.0, 0.0), "light_colour": (1.0, 1.0, 1.0), "ambient_up": (0.3, 0.3, 0.3),
        "ambient_down": (0.2, 0.2, 0.2),
    }  # fmt: skip
    return Outfit(outfit.kind, outfit.parts, (0.0, 0.0, 1.0), values)


def names_of(row: dict[str, str]) -> str:
    """Text of a label in the picture: the short name if a set has one."""
    return row["pig39"] or row["cmu41"] or row["name"].removeprefix(row["side"] + "_").replace("_", " ")


def place(px: FloatArray, texts: list[str], width: int, height: int) -> FloatArray:
    """Positions of texts (N, 2): left and right of the centre of the picture, moved apart vertically."""
    out = np.zeros_like(px)
    middle = (px[:, 0].min() + px[:, 0].max()) / 2
    for right in (False, True):
        side = np.nonzero((px[:, 0] > middle) == right)[0]
        order = side[np.argsort(px[side, 1])]
        y = px[order, 1].copy()
        for _ in range(200):  # neighbours at least a line apart
            gap = np.diff(y)
            push = np.clip(15 - gap, 0, None) / 2
            y[:-1] -= push
            y[1:] += push
        text_width = np.array([cv2.getTextSize(texts[i], cv2.FONT_HERSHEY_SIMPLEX, 0.42, 1)[0][0] for i in order])
        out[order, 1] = np.clip(y, 14, height - 6)
        out[order, 0] = width - 8 - text_width if right else 8
    return out


def panel(renderer: Renderer, rows: list[dict[str, str]], landmarks: Float32Array, number: int) -> ByteArray:
    """One picture with the markers that the camera sees."""
    center, span, direction, (height, width), words = PANELS[number]
    to_camera = np.array(direction, float) / np.linalg.norm(direction)
    distance, square = 12 * span, 2 * height
    eye = np.array(center) + to_camera * distance
    principal = (square - 1) / 2
    view = View(look_at(eye, np.array(center)), square * distance / span, (principal, principal), square, square)
    light = to_camera + np.array([0.35, 0.0, 0.6])
    outfit = dataclasses.replace(plain_outfit(), light=tuple(float(x) for x in light / np.linalg.norm(light)))
    shot = renderer.render(view, outfit, landmarks)
    alpha = shot.rgba[..., 3:] / 255
    square_image = (shot.rgba[..., 2::-1] * alpha + np.array(PAPER) * (1 - alpha)).astype(np.uint8)
    image = cv2.resize(square_image, (height, height), interpolation=cv2.INTER_AREA)
    shift = (width - height) // 2
    canvas = np.full((height, width, 3), PAPER, np.uint8)
    canvas[:, max(0, shift) : shift + height] = image[:, max(0, -shift) : width - shift]
    px = (shot.markers_px + 0.5) / 2 - 0.5 + [shift, 0]
    shown = shot.markers_visible & (px > 0).all(1) & (px < [width, height]).all(1)
    ids = np.array([i for i in np.nonzero(shown)[0] if any(w in rows[i]["name"] for w in words)])
    texts = [names_of(rows[i]) for i in ids]
    for i, text, at in zip(ids, texts, place(px[ids], texts, width, height), strict=True):
        colour = COLOURS[rows[i]["side"]]
        length = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.42, 1)[0][0]
        end = (int(at[0]) + (length + 3 if at[0] < width / 2 else -3), int(at[1]) - 4)
        spot = (round(float(px[i, 0])), round(float(px[i, 1])))
        cv2.line(canvas, end, spot, (190, 186, 182), 1, cv2.LINE_AA)
        cv2.putText(canvas, text, (int(at[0]), int(at[1])), cv2.FONT_HERSHEY_SIMPLEX, 0.42, INK, 1, cv2.LINE_AA)
        cv2.circle(canvas, spot, 4, (255, 255, 255), -1, cv2.LINE_AA)
        cv2.circle(canvas, spot, 3, colour, -1, cv2.LINE_AA)
    return canvas


def table_text(rows: list[dict[str, str]]) -> str:
    """The table in Markdown."""
    lines = ["| landmark | side | triangle | weights | tolerance, mm | Plug-in Gait | CMU |", "|" + " --- |" * 7]
    for r in rows:
        triangle = " ".join(r[f"vertex_{k}"] for k in "abc")
        weights = " ".join(f"{float(r[f'weight_{k}']):.2f}" for k in "abc")
        cells = (r["name"], r["side"], triangle, weights, r["tolerance_mm"], r["pig39"], r["cmu41"])
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    body = BodyModel(0)
    renderer = Renderer(body)
    labels = list(body.model.phenotype_labels)
    phenotypes = np.full((1, len(labels)), 0.5, np.float32)
    phenotypes[0, labels.index("age")] = 2 / 3
    vertices, landmarks, _, _ = body.forward(np.zeros((1, len(body.bones), 3)), phenotypes)
    renderer.load(vertices[0])
    with TABLE.open(newline="") as file:
        rows = list(csv.DictReader(file))
    if tuple(r["name"] for r in rows) != SURFACE.names:
        raise SystemExit(f"{TABLE}: its names are not those of SURFACE")
    panels = [panel(renderer, rows, landmarks[0], i) for i in range(len(PANELS))]
    sheet = np.vstack([np.hstack(panels[:3]), np.hstack(panels[3:])])
    cv2.imwrite(str(DOCS / "assets" / "markers.webp"), sheet, [cv2.IMWRITE_WEBP_QUALITY, 85])
    page = DOCS / "reference" / "landmarks.md"
    if page.exists() and TABLE_HEAD in page.read_text():
        start = page.read_text().split(TABLE_HEAD)[0]
        page.write_text(f"{start}{TABLE_HEAD}\n{table_text(rows)}")
    print(f"{DOCS / 'assets' / 'markers.webp'}: {sheet.shape[1]} x {sheet.shape[0]}")


if __name__ == "__main__":
    main()
