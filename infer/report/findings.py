"""What went wrong and where, in sentences: each names the place, the size and what to do about it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.infer.report.figures import BoneFigures, CameraFigures, Headline, coverage, gaps, jumps, nanmedian
from muybridge.infer.runtime.wording import join_words, readable

# Leave-one-camera-out error at the person, millimetres.
GOOD_MM, FAIR_MM = 20.0, 45.0
GOOD_COVERAGE, FAIR_COVERAGE = 0.98, 0.9
# Variation of the length of a bone that is longer than those of the feet; takes that agree with their ground truth have
# less than 0.12. Two cameras agree on any depth, but bone lengths reveal a wrong one.
_LOOSE, _WILD, _LONG_M = 0.2, 0.35, 0.12
# Shares of the stature: Winter, "Biomechanics and Motor Control of Human Movement", 2009, fig. 4.1.
_OF_STATURE = {"hip to knee": 0.245, "knee to ankle": 0.246, "shoulder to elbow": 0.186, "elbow to wrist": 0.146}
# From toddlers to the tallest, judged by bone lengths.
_STATURE_M = (0.55, 2.6)


@dataclass(frozen=True)
class Finding:
    """One sentence of the report.

    Attributes:
        severity: ``"bad"`` (spoils the result), ``"look"`` (worth a look) or ``"note"``.
        text: one or two sentences.
        frame: a frame that shows it, -1 if it is everywhere.
    """

    severity: str
    text: str
    frame: int = -1


def findings(
    points: Points3D,
    cameras: Sequence[CameraFigures],
    bones: Sequence[BoneFigures],
    warnings: Sequence[str] = (),
    diagnosis_known: bool = False,
) -> tuple[Finding, ...]:
    """Findings about a take, the worst first.

    Args:
        points: the take.
        cameras: `figures.camera_figures` of it.
        bones: `figures.bone_figures` of it.
        warnings: notices of the run; they come first among equals.
        diagnosis_known: the calibration's diagnosis has already determined which cameras are turned or out of step,
            which is more reliable than the signs used here.
    """
    if coverage(points) == 0.0:
        return (
            Finding(
                "bad",
                "No landmark has a 3D position in any frame. Look at the overlays: if the 2D marks are on "
                "the person, the calibration does not belong to these videos; if there are none, the person "
                "was not found.",
            ),
            *(Finding("look", text) for text in warnings),
        )
    found = [Finding("look", text) for text in warnings]
    found += _size_findings(bones)
    found += _camera_findings(cameras)
    found += _sign_findings(cameras, diagnosis_known)
    found += _gap_findings(points)
    found += _landmark_findings(points, cameras)
    found += _jump_findings(points)
    found += _bone_findings(bones)
    return sort_findings(found)


def sort_findings(found: Iterable[Finding]) -> tuple[Finding, ...]:
    """The findings, the worst first; the order among equals is kept."""
    order = {"bad": 0, "look": 1, "note": 2}
    return tuple(sorted(found, key=lambda finding: order[finding.severity]))


def verdict(figures: Headline, bones: Sequence[BoneFigures]) -> tuple[str, str]:
    """(rating, sentence): ``"good"``, ``"fair"`` or ``"poor"``, and why."""
    covered, error = figures.coverage, figures.agreement_mm
    if not np.isfinite(error):
        return "poor", "Nothing was triangulated in this take."
    levels = ("good", "fair", "poor")
    by_error = 0 if error <= GOOD_MM else 1 if error <= FAIR_MM else 2
    by_coverage = 0 if covered >= GOOD_COVERAGE else 1 if covered >= FAIR_COVERAGE else 2
    alone = np.isfinite(figures.leave_one_out_px)
    known = "from where the other cameras put it" if alone else "from its own reprojection"
    subject = f"What one camera sees of a landmark is typically {error:.0f} mm {known}"
    if figures.from_body:
        subject = f"A point is typically {error:.0f} mm from where the fitted body has it"
    sentence = f"{subject}, and {100 * covered:.1f} % of all landmarks and frames have a 3D position."
    spread, name = max(((b.spread, b.name) for b in bones if b.median_m > _LONG_M), default=(0.0, ""))
    by_bones = 0 if spread < _LOOSE else 1 if spread < _WILD else 2
    if by_bones:
        sentence += f" But the bone {name} changes its length by ±{100 * spread:.0f} %: points are misplaced in depth."
    return levels[max(by_error, by_coverage, by_bones)], sentence


def _size_findings(bones: Sequence[BoneFigures]) -> list[Finding]:
    """A person of impossible size: the calibration's lengths are not in metres."""
    sides = ("left ", "right ")
    shares = {side + name: share for name, share in _OF_STATURE.items() for side in sides}
    stature = float(nanmedian(np.array([b.median_m / shares[b.name] for b in bones if b.name in shares] or [np.nan])))
    if not np.isfinite(stature) or _STATURE_M[0] <= stature <= _STATURE_M[1]:
        return []
    return [
        Finding(
            "bad",
            f"By the lengths of arms and legs the person is {stature:.2g} m tall: the calibration's lengths are not "
            f"in the assumed unit. State their unit (docs/reference/calibration-files.md), or calibrate with the "
            f"true size of the board's squares.",
        )
    ]


def _error_mm(camera: CameraFigures) -> float:
    value = camera.leave_one_out_px if np.isfinite(camera.leave_one_out_px) else camera.residual_px
    return value * camera.mm_per_px


def _camera_findings(cameras: Sequence[CameraFigures]) -> list[Finding]:
    """Cameras that disagree with the rest, see little, or were often rejected."""
    found = []
    errors = np.array([_error_mm(c) for c in cameras])
    for c, camera in enumerate(cameras):
        others = float(nanmedian(np.delete(errors, c))) if len(cameras) > 1 else float("nan")
        if errors[c] > 1.5 * others and errors[c] > 15.0:
            found.append(
                Finding(
                    "bad" if errors[c] > 2.5 * others and errors[c] > FAIR_MM else "look",
                    f"{camera.name} disagrees with the others: {errors[c]:.0f} mm at the person against "
                    f"{others:.0f} mm. If its 2D marks are on the person in the overlay, its calibration or "
                    f"its synchronisation is off; if they are not, its view is hard.",
                )
            )
        if camera.seen == 0.0:
            found.append(Finding("bad", f"{camera.name} found the person in no frame."))
        elif camera.seen < 0.6:
            found.append(
                Finding("look", f"{camera.name} has 2D points for only {100 * camera.seen:.0f} % of the take.")
            )
        if camera.rejected > 0.25:
            found.append(
                Finding(
                    "look",
                    f"{100 * camera.rejected:.0f} % of the 2D points of {camera.name} took no part, because "
                    f"the other cameras agree on something else.",
                )
            )
    return found


def _sign_findings(cameras: Sequence[CameraFigures], diagnosis_known: bool) -> list[Finding]:
    """Causes that the residuals of a camera suggest: a constant shift, a lag, left-right flips."""
    found = []
    shifted = [c for c in cameras if _is_shifted(c) and not diagnosis_known]
    if shifted:
        each = join_words([f"{c.name} by {np.linalg.norm(c.bias_px):.0f} px ({_direction(c)})" for c in shifted])
        most_mm = max(float(np.linalg.norm(c.bias_px)) * c.mm_per_px for c in shifted)
        found.append(
            Finding(
                "bad" if most_mm > 25.0 else "look",
                f"The calibration looks off. The 2D points are shifted throughout the take, in {each}. "
                f"Wrong 2D points would scatter; a constant shift comes from the calibration, or from a "
                f"video that was cropped or scaled after it.",
            )
        )
    for camera in cameras:
        if abs(camera.lag_frames) >= 0.5 and not diagnosis_known:
            ahead = "ahead of" if camera.lag_frames > 0 else "behind"
            found.append(
                Finding(
                    "bad" if abs(camera.lag_frames) > 1.5 else "look",
                    f"{camera.name} seems to run about {abs(camera.lag_frames):.1f} frames {ahead} the other "
                    f"cameras: its points are off along the motion. Check that the videos start together.",
                )
            )
        if camera.flipped > 0.02:
            found.append(
                Finding(
                    "look",
                    f"{camera.name} takes left for right in {100 * camera.flipped:.0f} % of its left-right "
                    f"pairs, for instance around frame {camera.flipped_frame}.",
                    camera.flipped_frame,
                )
            )
    return found


def _is_shifted(camera: CameraFigures) -> bool:
    bias = float(np.linalg.norm(camera.bias_px))
    return bias > 0.6 * camera.residual_px and bias * camera.mm_per_px > 8.0


def _direction(camera: CameraFigures) -> str:
    x, y = camera.bias_px
    parts = []
    if abs(x) > 0.4 * abs(y):
        parts.append("right" if x > 0 else "left")
    if abs(y) > 0.4 * abs(x):
        parts.append("down" if y > 0 else "up")
    return " and ".join(parts)


def _gap_findings(points: Points3D, most: int = 5) -> list[Finding]:
    """Frames without anybody, then the longest gaps of single landmarks."""
    names, frames = points.landmarks.names, len(points.points_world)
    all_gaps = gaps(points)
    if not all_gaps:
        return []
    found: list[Finding] = []
    covers = np.zeros(frames, int)
    for gap in all_gaps:
        covers[gap.first : gap.last + 1] += 1
    empty = np.flatnonzero(covers == len(names))
    if len(empty):
        found.append(
            Finding(
                "bad" if len(empty) > 0.05 * frames else "look",
                f"In {len(empty)} of {frames} frames there is no 3D point at all, first in frame {empty[0]}.",
                int(empty[0]),
            )
        )
    # Gaps that only span frames without anybody are reported above.
    single = [g for g in all_gaps if (covers[g.first : g.last + 1] < len(names)).any()]
    long = [g for g in single if g.frames > max(2, 0.05 * points.fps)]
    for gap in long[:most]:
        found.append(
            Finding(
                "look",
                f"{readable(names[gap.landmark]).capitalize()} is missing {_span(gap.first, gap.last)} "
                f"({gap.frames / points.fps:.2f} s).",
                (gap.first + gap.last) // 2,
            )
        )
    rest = len(single) - len(long[:most])
    if rest:
        also = "more, " if long else ""
        found.append(Finding("note", f"{rest} {also}shorter gap{'s' if rest > 1 else ''}; the timeline shows where."))
    return found


def _span(first: int, last: int) -> str:
    return f"in frame {first}" if first == last else f"in frames {first} to {last}"


def _landmark_findings(points: Points3D, cameras: Sequence[CameraFigures], most: int = 3) -> list[Finding]:
    """The landmarks that the cameras agree on least."""
    scale = np.array([c.mm_per_px for c in cameras])[:, None, None]
    median = nanmedian(points.residual_px * scale, axis=(0, 1))
    typical = float(nanmedian(median))
    found = []
    worst = [j for j in np.argsort(-np.nan_to_num(median)).tolist() if median[j] > max(1.6 * typical, 10.0)]
    for j in worst[:most]:
        series = nanmedian(points.residual_px[:, :, j] * scale[:, :, 0], axis=0)
        frame = int(np.nanargmax(series))
        found.append(
            Finding(
                "look",
                f"{readable(points.landmarks.names[j]).capitalize()} is placed worst: the cameras miss each "
                f"other by {median[j]:.0f} mm in the median (all landmarks: {typical:.0f} mm), most "
                f"in frame {frame}.",
                frame,
            )
        )
    return found


def _jump_findings(points: Points3D, most: int = 3) -> list[Finding]:
    """Landmarks that jump from one frame to the next."""
    found_jumps = jumps(points)
    found = [
        Finding(
            "look",
            f"{readable(points.landmarks.names[j]).capitalize()} jumps {100 * size:.0f} cm between frames "
            f"{t - 1} and {t}, which no body does.",
            t,
        )
        for size, j, t in found_jumps[:most]
    ]
    if len(found_jumps) > most:
        found.append(Finding("note", f"There are {len(found_jumps) - most} more jumps of this kind."))
    return found


def _bone_findings(bones: Sequence[BoneFigures], most: int = 3) -> list[Finding]:
    """Bones whose length varies, or differs between the sides."""
    found = []
    loose = sorted((b for b in bones if b.spread > 0.1 and b.spread_m > 0.015), key=lambda b: -b.spread)
    for bone in loose[:most]:
        found.append(
            Finding(
                "bad" if bone.spread >= _LOOSE and bone.median_m > _LONG_M else "look",
                f"The bone {bone.name} changes its length by ±{100 * bone.spread:.0f} % "
                f"(±{1000 * bone.spread_m:.0f} mm of {1000 * bone.median_m:.0f}), most in frame "
                f"{bone.worst_frame}: one of its ends is misplaced at times. The fitted motion holds it "
                f"fixed.",
                bone.worst_frame,
            )
        )
    for i, bone in enumerate(bones):
        if bone.twin <= i:
            continue
        twin = bones[bone.twin]
        difference = abs(bone.median_m - twin.median_m)
        if difference > 0.12 * max(bone.median_m, twin.median_m) and difference > 0.025:
            name = bone.name.replace("left ", "").replace("right ", "")
            found.append(
                Finding(
                    "look",
                    f"Left and right differ from {name}: {1000 * bone.median_m:.0f} mm and "
                    f"{1000 * twin.median_m:.0f} mm.",
                )
            )
    return found
