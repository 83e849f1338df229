"""Draw the diagrams of the documentation: `python scripts/docs/figures.py` writes docs/assets/*.svg."""

from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("svg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse, FancyBboxPatch, Polygon

ASSETS = Path(__file__).parents[2] / "docs" / "assets"
TEAL, ORANGE, GREY, RED, GREEN, BLUE = "#00897b", "#ef6c00", "#607d8b", "#c62828", "#2e7d32", "#1565c0"
plt.rcParams |= {"svg.hashsalt": "muybridge", "font.family": "sans-serif", "font.size": 11}


def main() -> None:
    """Write every diagram."""
    for draw in (pipeline, axes_world, axes_camera, axes_pixels, triangulation, uncertainty, skeleton, smoothing):
        draw()
        plt.savefig(ASSETS / f"{draw.__name__}.svg", bbox_inches="tight", metadata={"Date": None})
        plt.close("all")


def _blank(width: float, height: float) -> Axes:
    _, axes = plt.subplots(figsize=(width, height))
    axes.set_aspect("equal")
    axes.axis("off")
    return axes


def _box(
    axes: Axes, x: float, y: float, text: str, colour: str = TEAL, width: float = 2.6, height: float = 0.8
) -> None:
    axes.add_patch(
        FancyBboxPatch(
            (x - width / 2, y - height / 2),
            width,
            height,
            boxstyle="round,pad=0.06",
            fc=f"{colour}22",
            ec=colour,
            lw=1.5,
        )
    )
    axes.text(x, y, text, ha="center", va="center", fontsize=10)


def _arrow(
    axes: Axes, start: tuple[float, float], end: tuple[float, float], colour: str = GREY, style: str = "->"
) -> None:
    axes.annotate(
        "", end, start, arrowprops={"arrowstyle": style, "color": colour, "lw": 1.6, "shrinkA": 0, "shrinkB": 0}
    )


def pipeline() -> None:
    """What becomes of videos, marker videos and marker recordings."""
    axes = _blank(9.2, 4.6)
    rows = {"videos\nof people": 2.6, "videos of\nreflective markers": 1.3, "marker\nrecordings": 0.0}
    for text, y in rows.items():
        _box(axes, 0, y, text, GREY)
    _box(axes, 3.2, 2.6, "people and 2D\nlandmarks per view")
    _box(axes, 3.2, 1.3, "2D dots per view")
    _box(axes, 3.2, 0.0, "tracking and\nlabelling")
    for y in rows.values():
        _arrow(axes, (1.36, y), (1.84, y))
    _box(axes, 6.6, 1.95, "association and\nrobust triangulation")
    _arrow(axes, (4.56, 2.6), (5.24, 2.2))
    _arrow(axes, (4.56, 1.3), (5.24, 1.7))
    _box(axes, 10.0, 0.95, "labelled 3D points\nwith uncertainty", ORANGE)
    _arrow(axes, (7.96, 1.75), (8.64, 1.25))
    _arrow(axes, (4.56, 0.0), (8.64, 0.65))
    _box(axes, 10.0, -1.0, "smoothing and\nskeleton fit")
    _box(axes, 6.6, -1.6, "files: BVH, FBX, glTF,\nTRC, C3D, MOT, ...", GREY)
    _box(axes, 3.0, -1.6, "report and\noverlay videos", GREY)
    _arrow(axes, (10.0, 0.48), (10.0, -0.52))
    _arrow(axes, (8.64, -1.2), (7.96, -1.5))
    _arrow(axes, (5.24, -1.6), (4.36, -1.6))
    axes.set(xlim=(-1.5, 11.6), ylim=(-2.2, 3.2))


def _axis(axes: Axes, origin: tuple[float, float], tip: tuple[float, float], name: str, colour: str) -> None:
    end = (origin[0] + tip[0], origin[1] + tip[1])
    _arrow(axes, origin, end, colour)
    along = np.array(tip) / np.hypot(*tip)
    place = "center" if abs(along[0]) < 0.3 else "left"
    axes.text(end[0] + 0.12 * along[0], end[1] + 0.25 * along[1], name, color=colour, ha=place, va="center")


def axes_world() -> None:
    """The world's axes."""
    axes = _blank(3.4, 2.6)
    tips = (((1.2, -0.35), "x (left)", RED), ((0.75, 0.65), "y (back)", GREEN), ((0, 1.6), "z (up)", BLUE))
    for tip, name, colour in tips:
        _axis(axes, (0, 0), tip, name, colour)
    axes.set(xlim=(-0.8, 2.4), ylim=(-0.6, 2.1))


def axes_camera() -> None:
    """A camera's axes."""
    axes = _blank(3.6, 2.6)
    corner = np.array([0.0, 0.2])
    axes.add_patch(Polygon(corner + [[0, 0], [1.3, 0.5], [1.3, -0.9], [0, -0.4]], fc="#607d8b33", ec=GREY))
    axes.plot([corner[0]] * 2, [corner[1], corner[1] - 0.4], color=GREY, lw=3)
    tips = (((1.4, 0), "z (forward)", BLUE), ((0, -1.1), "y (down)", GREEN), ((0.7, 0.6), "x (right)", RED))
    for tip, name, colour in tips:
        _axis(axes, (1.3, 0.0), tip, name, colour)
    axes.set(xlim=(-0.2, 4.2), ylim=(-1.6, 1.1))


def axes_pixels() -> None:
    """The pixels' origin and axes."""
    axes = _blank(3.4, 2.8)
    for i in range(5):
        axes.plot([0.55 * i] * 2, [0.0, -2.2], color=GREY, lw=0.8)
        axes.plot([0, 2.2], [-0.55 * i] * 2, color=GREY, lw=0.8)
    axes.plot(0.275, -0.275, "o", color=ORANGE)
    axes.text(0.275, 0.2, "(0, 0)", color=ORANGE, ha="center")
    _axis(axes, (0.275, -0.275), (2.4, 0), "x", RED)
    _axis(axes, (0.275, -0.275), (0, -2.3), "y", GREEN)
    axes.set(xlim=(-0.4, 3.2), ylim=(-3.0, 0.6))


def triangulation() -> None:
    """Four rays of which one is wrong: least squares and a robust estimate, computed."""
    axes = _blank(7.4, 4)
    truth = np.array([0.3, 0.2])
    cameras = np.array([[-4, -1.6], [-3.2, 2.4], [3.6, 2.2], [4.2, -1.2]])
    aims = np.array([truth, truth, truth + [0.05, -0.03], truth + [0.5, 1.5]])
    directions = (aims - cameras) / np.linalg.norm(aims - cameras, axis=1, keepdims=True)
    normals = directions @ np.array([[0, 1], [-1, 0]])
    offsets = np.sum(normals * cameras, axis=1)
    squares = np.linalg.lstsq(normals, offsets, rcond=None)[0]
    robust = np.linalg.lstsq(normals[:3], offsets[:3], rcond=None)[0]
    for c, (camera, direction) in enumerate(zip(cameras, directions, strict=True)):
        wrong = c == 3
        end = camera + 7.2 * direction
        axes.plot(*zip(camera, end, strict=True), color=RED if wrong else TEAL, lw=1.4, ls="--" if wrong else "-")
        side = np.array([-direction[1], direction[0]])
        axes.add_patch(
            Polygon([camera, camera - 0.5 * direction + 0.3 * side, camera - 0.5 * direction - 0.3 * side], fc=GREY)
        )
        axes.text(*(camera - 0.95 * direction), f"cam{c + 1}", ha="center", va="center")
    axes.plot(*squares, "s", color=ORANGE, ms=9, zorder=3)
    axes.plot(*robust, "o", color=GREEN, ms=9, zorder=3)
    axes.annotate(
        "least squares",
        squares,
        squares + [-0.2, 1.5],
        color=ORANGE,
        ha="center",
        arrowprops={"arrowstyle": "-", "color": ORANGE},
    )
    axes.annotate(
        "robust", robust, robust + [0.1, -1.7], color=GREEN, ha="center", arrowprops={"arrowstyle": "-", "color": GREEN}
    )
    axes.text(*(cameras[3] + 2.0 * directions[3] + [0.9, 0.2]), "wrong landmark", color=RED, ha="center")
    axes.set(xlim=(-5.4, 5.6), ylim=(-2.9, 3.3))


def uncertainty() -> None:
    """A heatmap with two hypotheses, and what two cones of uncertainty make of it."""
    _, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.5), width_ratios=(1, 1.5))
    x, y = np.meshgrid(np.arange(40), np.arange(40))
    heat = np.exp(-((x - 13) ** 2 + (y - 22) ** 2) / 12) + 0.35 * np.exp(-((x - 27) ** 2 + (y - 19) ** 2) / 14)
    p = heat / heat.sum()
    sigma = float(np.sqrt((p * ((x - 13) ** 2 + (y - 22) ** 2)).sum() / 2))
    left.pcolormesh(x, y, heat, cmap="GnBu", rasterized=True)
    left.invert_yaxis()
    left.plot(13, 22, "+", color=RED, ms=12, mew=2)
    left.add_patch(Ellipse((13, 22), 2 * sigma, 2 * sigma, fc="none", ec=RED, lw=1.5))
    left.set(title="heatmap of the left ankle", xticks=[], yticks=[], aspect="equal")
    left.text(27, 26, "the right one", ha="center", fontsize=9)
    left.text(13, 33, "position and\none sigma", ha="center", color=RED, fontsize=9)
    right.set_aspect("equal")
    right.axis("off")
    target, half = np.array([0.0, 3.4]), np.deg2rad(4)
    for camera, wide in ((np.array([-1.6, 0.0]), half), (np.array([1.6, 0.0]), half)):
        angle = np.arctan2(*(target - camera)[::-1])
        ends = [camera + 5 * np.array([np.cos(angle + s * wide), np.sin(angle + s * wide)]) for s in (-1, 1)]
        right.add_patch(Polygon([camera, *ends], fc=f"{TEAL}33", ec=TEAL, lw=0.8))
        right.plot(*camera, "s", color=GREY, ms=9)
    right.add_patch(Ellipse(tuple(target), 0.42, 0.95, fc=f"{RED}44", ec=RED, lw=1.6))
    right.text(0.75, 3.4, "3D covariance: long along\nthe common direction of view", color=RED, fontsize=9, va="center")
    right.text(0, -0.45, "two cameras", ha="center", fontsize=9)
    right.set(xlim=(-2.6, 4.2), ylim=(-0.8, 5))


def skeleton() -> None:
    """The skeleton's rest pose from the front, by the package's own proportions."""
    from muybridge.geometry.skeleton.body import BODY, prior_shape

    body = BODY.skeleton(prior_shape(1.75))
    places = np.zeros((len(body.names), 3))
    for j, parent in enumerate(body.parents):
        places[j] = body.offsets[j] + (places[parent] if parent >= 0 else 0)
    axes = _blank(8.4, 7)
    shown = places[:, [0, 2]]  # it faces -Y, so its left is at the reader's right
    for j, parent in enumerate(body.parents):
        name = body.names[j]
        colour = ORANGE if name.startswith("left") else TEAL if name.startswith("right") else GREY
        if parent >= 0:
            axes.plot(*zip(shown[parent], shown[j], strict=True), color=colour, lw=3, solid_capstyle="round")
        axes.plot(*shown[j], "o", color=colour, ms=6)
    for name in body.names:
        if name.startswith("right"):
            continue
        at = shown[body.names.index(name)]
        middle = not name.startswith("left")
        arm = name in ("left_clavicle", "left_upper_arm", "left_forearm", "left_hand")
        shift = (-0.14, 0.05) if name == "hips" else (-0.05, 0.0) if middle else (0.0, 0.04) if arm else (0.05, 0.0)
        turned = (
            {"rotation": 40, "ha": "left", "va": "bottom"}
            if arm
            else {"ha": "right" if middle else "left", "va": "center"}
        )
        axes.text(at[0] + shift[0], at[1] + shift[1], name, fontsize=9, **turned)
    axes.set(xlim=(-0.95, 1.1), ylim=(shown[:, 1].min() - 0.1, shown[:, 1].max() + 0.25))


def smoothing() -> None:
    """A noisy signal with outliers and a gap, through two of the package's filters."""
    from muybridge.geometry.smoothing.filters import FilterOptions, hampel, smooth
    from muybridge.geometry.smoothing.gaps import fill_gaps

    rng = np.random.default_rng(4)
    fps, t = 60.0, np.arange(150) / 60.0
    truth = 0.25 * np.sin(2 * np.pi * 0.8 * t) + 0.06 * np.sin(2 * np.pi * 2.1 * t + 1)
    measured = truth + rng.normal(0, 0.02, len(t))
    measured[rng.choice(len(t), 7, replace=False)] += rng.choice([-0.3, 0.3], 7)
    measured[88:103] = np.nan
    points = np.stack([measured, 0 * measured, 0 * measured], axis=-1)[:, None]  # (T, 1, 3): one marker
    whole = fill_gaps(hampel(points, half=6)[0], fps)
    rough = fill_gaps(points, fps)
    _, axes = plt.subplots(figsize=(8.4, 3.2))
    axes.plot(t, 1000 * truth, color="black", lw=1, ls=":", label="truth")
    axes.plot(t, 1000 * measured, ".", color=GREY, ms=5, label="measured")
    axes.plot(
        t,
        1000 * smooth(whole[:, 0, :1], fps, "kalman")[:, 0],
        color=TEAL,
        lw=2,
        label="outliers removed, gap filled, Kalman smoother",
    )
    axes.plot(
        t,
        1000 * smooth(rough, fps, "butterworth", FilterOptions(cutoff_hz=6.0))[:, 0, 0],
        color=ORANGE,
        lw=1.2,
        label="Butterworth 6 Hz, outliers kept",
    )
    axes.axvspan(t[88], t[102], color="#90a4ae33", lw=0)
    axes.text(t[95], -430, "gap", ha="center", color=GREY)
    axes.set(xlabel="time, s", ylabel="position, mm", ylim=(-480, 560))
    axes.legend(loc="upper left", ncols=2, fontsize=8, frameon=False)
    axes.spines[["top", "right"]].set_visible(False)


if __name__ == "__main__":
    main()
