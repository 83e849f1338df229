"""The names of results, which commands look for that do not make them."""

from pathlib import Path

DEFAULT_OUT = "muybridge"  # the results folder within a session
POINTS_TRC, POINTS_C3D, MARKERS_C3D = "points.trc", "points.c3d", "markers.c3d"
MOTION_BVH, MOTION_GLB, MOTION_MOT = "motion.bvh", "motion.glb", "motion.mot"
REPORT = "report.html"
PERSONAL = POINTS_TRC, POINTS_C3D, MOTION_BVH, MOTION_GLB, MARKERS_C3D, REPORT
# Most people that get files; those of least interest get none.
MOST_PEOPLE = 12


def of_person(name: str, number: int) -> str:
    """A result's name for a person: `points.trc` of the second is `points_2.trc`."""
    path = Path(name)
    return name if number == 1 else f"{path.stem}_{number}{path.suffix}"
