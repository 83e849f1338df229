"""What a laboratory measured on the subject, as a C3D of its gait model keeps it (PROCESSING)."""

from pathlib import Path
from typing import Any

import numpy as np

from muybridge.geometry.skeleton.joint_centres import Measurements
from muybridge.motion.formats.points.c3d_read import read_raw_c3d

# Parameter of Plug-in Gait (a side's without its letter): attribute, and the least and most of a person in millimetres.
_SIDED = {"LegLength": ("leg_length", 300, 1300), "KneeWidth": ("knee_width", 50, 200),
          "AnkleWidth": ("ankle_width", 35, 130), "ElbowWidth": ("elbow_width", 35, 130)}  # fmt: skip
_DIAMETERS = ("MarkerDiameter", "Marker Diameter")


def measurements_of(path: Path) -> Measurements:
    """The subject's measurements in a C3D; none from other files. Numbers that no person has are left out.

    Raises:
        FormatError: the file is not a C3D.
    """
    if path.suffix.lower() != ".c3d":
        return Measurements()
    parameters = read_raw_c3d(path).parameters
    if (_number(parameters.get("SUBJECTS", {}).get("USED")) or 0) > 1:
        return Measurements()  # it does not say whose they are
    group = {key.lower(): value for key, value in parameters.get("PROCESSING", {}).items()}

    def metres(name: str, least: float, most: float) -> float | None:
        value = _number(group.get(name.lower()))
        return value / 1e3 if value is not None and least <= value <= most else None

    sided: dict[str, dict[str, float]] = {}
    for name, (attribute, least, most) in _SIDED.items():
        both = {side: metres(side[0] + name, least, most) for side in ("left", "right")}
        sided[attribute] = {side: value for side, value in both.items() if value is not None}
    diameter = next((d for n in _DIAMETERS if (d := metres(n, 3, 40)) is not None), None)
    return Measurements(metres("InterAsisDistance", 120, 400), diameter, **sided)


def _number(value: Any) -> float | None:
    try:
        number = float(np.ravel(value)[0])
    except (TypeError, ValueError, IndexError):
        return None
    return number if np.isfinite(number) else None
