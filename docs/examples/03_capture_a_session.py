"""A session folder to motion files: what `muybridge run` does, from your own program.

    python 03_capture_a_session.py SESSION OUT

`SESSION` holds `videos/` and a calibration. A run that was interrupted resumes.
"""

import sys
from pathlib import Path

import muybridge


def report(stage: str, done: int, total: int, seconds_left: float | None) -> bool:
    """Show progress on one line; returning False would cancel the run."""
    left = "" if seconds_left is None else f", {seconds_left:.0f} s left"
    print(f"\r{stage}: {done} of {total}{left}".ljust(60), end="", file=sys.stderr)
    return True


session, out = Path(sys.argv[1]), Path(sys.argv[2])
result = muybridge.capture(session, out=out, progress=report)
print(file=sys.stderr)

points = result.points["body23"]
frames, landmarks, _ = points.points_world.shape  # metres, Z up; NaN where missing
print(f"{frames} frames of {landmarks} landmarks at {points.fps:g} frames/s")
print(f"coverage {result.quality.coverage:.1%}, leave-one-camera-out {result.quality.leave_one_out_px:.1f} px")
for sentence in (*result.notices, *result.problems):
    print("-", sentence)

result.save(out / "motion.fbx")  # the command writes BVH and glTF; any other format is one line more
result.save(out / "points.csv")
