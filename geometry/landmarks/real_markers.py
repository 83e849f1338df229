"""Which points of a file are markers, and which were computed from them.

Gait models write their results as points beside the markers: axes of segments, joint centres, the centre of mass,
angles, forces. None of them is on the skin, so labelling, solving and learning a set leave them out by the same rules.

Sources: Vicon, Plug-in Gait reference guide (outputs and their names); The C3D File Format, user guide
(POINT:TYPE_GROUPS and the parameters that it lists); names that Visual3D, Theia3D and Cortex give to what they export.
"""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from muybridge.arrays import BoolArray
from muybridge.geometry.landmarks.marker_names import surface_of

# Parameters of a C3D file's group POINT that list points which are no markers.
LISTS = ("ANGLES", "FORCES", "MOMENTS", "POWERS", "SCALARS", "ENERGIES", "REACTIONS", "MODEL_OUTPUTS",
         "MODELED_MARKERS", "BONES")  # fmt: skip

_MODELLED, _AXES, _QUANTITIES = "outputs listed in the file", "segment axes", "angles, forces and the like"
_CENTRES, _MASS, _VIRTUAL, _POSES = "joint centres", "centres of mass", "virtual points", "poses of segments"
# The inferior angle of the scapula is a place on the skin.
_QUANTITY = re.compile(
    r"(?i:(?:angle|force|moment|torque|power|momentum|velocity|acceleration)s?(?:[ _.-]?(?:rot|norm\w*|[xyz]))*$)"
    r"|[A-Za-z]Angs?$|(?:^|[a-z _.-]|Normalised|^[LR])(?:GRF|GRM|COP)s?$|(?i:(?:^|[ _.-])(?:grf|grm|cop)[ _.-]?\d*$)"
)
_BONE_ANGLE = re.compile(r"(?i)scap|inf|sup|acrom")
_CENTRE = re.compile(r"(?i)(?:^[lrv]?|[ _.-][lr]?)(?:[hkasew]jc|fhc)(?=$|[ _.\-\d])|joint[ _.-]?cent(?:er|re)")
_CENTRE_OF_MASS = re.compile(
    r"(?i:cent(?:er|re)[ _]?of[ _]?(?:mass|gravity))|(?:^|[a-z _.-])(?:COM|CoM|COG|CoG)(?:$|[ _.-]|Floor)"
    r"|(?:^|[ _.-])(?:com|cog)(?:$|[ _.-])"
)
_POSE = re.compile(r"(?i)(?:^|[ _.-])4x4(?:$|[ _.-])")
_ABSTRACT = re.compile(r"(?i)^(?:v[ _.-]|virtual)")
_UNNAMED = re.compile(r"(?i)^(?:\*\d*|unlabell?ed[ _-]?\d*|unnamed[ _-]?\d*|uname\W?\d+|point_\d+)$")
_AXIS_LETTERS = "OALP"


@dataclass(frozen=True, eq=False)
class PointKinds:
    """What the points of a file are.

    Attributes:
        marker: (K,) whether a point may be a marker.
        unnamed: (K,) markers to which the recording program gave a number for a name (``*12``).
        computed: why points are none -> their names.
    """

    marker: BoolArray
    unnamed: BoolArray
    computed: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def note(self) -> str:
        """One sentence on what is left out, empty where that is nothing."""
        parts = []
        for reason, names in self.computed.items():
            shown = ", ".join(names[:4]) + (", ..." if len(names) > 4 else "")
            parts.append(f"{len(names)} {reason} ({shown})" if len(names) > 1 else f"{names[0]} ({reason})")
        return f"left out because they are no markers: {'; '.join(parts)}" if parts else ""


def find_markers(names: Sequence[str], listed: Collection[str] = ()) -> PointKinds:
    """Tell markers from points that a program computed.

    Four names that differ in their last letter only, O, A, L and P, are the axes of a segment (Plug-in Gait). A name
    that a marker set knows is a marker, whatever it looks like (`V.Sacral`).

    Args:
        names: (K,) the file's names of its points.
        listed: names that the file itself lists as results (a C3D's `LISTS`).
    """
    plain = [name.rsplit(":", 1)[-1].strip() for name in names]
    axes = _axes(names)
    known = {name.strip() for name in listed} - {""}
    computed: dict[str, list[str]] = {}
    marker = np.ones(len(names), bool)
    for i, (name, short) in enumerate(zip(names, plain, strict=True)):
        reason = _AXES if i in axes else _reason(short)
        if reason is None and (name.strip() in known or short in known):
            reason = _MODELLED
        if reason is not None:
            computed.setdefault(reason, []).append(name)
            marker[i] = False
    unnamed = np.array([bool(_UNNAMED.match(short)) for short in plain], bool) & marker
    return PointKinds(marker, unnamed, {reason: tuple(found) for reason, found in computed.items()})


def _reason(name: str) -> str | None:
    if _CENTRE.search(name):
        return _CENTRES
    if _QUANTITY.search(name) and not _BONE_ANGLE.search(name):
        return _QUANTITIES
    if _CENTRE_OF_MASS.search(name):
        return _MASS
    if _POSE.search(name):
        return _POSES
    return _VIRTUAL if _ABSTRACT.match(name) and surface_of(name) is None else None


def _axes(names: Sequence[str]) -> set[int]:
    """Indices of complete groups of four axis points; subjects are kept apart by their prefixes."""
    at = {name.strip(): i for i, name in enumerate(names)}
    out: set[int] = set()
    for name in at:
        stem = name[:-1]
        group = [at.get(stem + letter) for letter in _AXIS_LETTERS]
        if name.endswith("O") and len(stem.rsplit(":", 1)[-1]) >= 2 and None not in group:
            out.update(i for i in group if i is not None)
    return out
