"""The results of a calibration diagnosis: faults of single cameras, and the options that decide what counts as one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from muybridge.arrays import FloatArray
from muybridge.geometry.cameras.group import CameraGroup

Kind = Literal["turned", "moved", "focal", "shifted", "swapped", "unrelated"]
KINDS: tuple[Kind, ...] = ("turned", "moved", "focal", "shifted", "swapped")


@dataclass(frozen=True)
class DiagnosisOptions:
    """Limits of the search and thresholds above which a deviation counts as a fault.

    Attributes:
        max_frames: maximum number of frames used, spread evenly over the take.
        max_shift: largest time shift that is tried, frames.
        max_faults: maximum number of faults reported.
        min_evidence: log-likelihood (nats) that an explanation must gain.
        min_evidence_more: the same for a second and further fault.
        chance: highest probability that any of the explanations tried seems as certain by chance.
        min_score: minimum mean gain over the landmarks in held-out observations, in standard errors.
        min_steady: the same over stretches of the take.
        min_deviations: minimum size of a fault in its own standard deviations.
        min_agreed: minimum share of the pairs of other cameras that confirm a time shift.
        max_spread: maximum deviation of the fault as fitted to a part of the observations, as a share of it.
        min_effect: minimum displacement of the camera's 2D points by the fault, in standard deviations of their noise.
        min_effect_of_person: the same as a share of the person's size in the image. A 2D network whose hip landmarks
            depend on the viewing direction is biased by a similar amount, so smaller displacements prove nothing.
        min_turn_deg, min_move, min_shift, min_focal: smallest rotation (degrees), translation (metres), time shift
            (frames) and relative change of the focal length that count as a fault.
        farthest_turn_deg: a camera that is turned by more than this and has a second fault shows a different scene.
        unrelated: error against the other cameras, as a share of the image's longer side, from which a video that no
            explanation corrects is taken to show a different scene.
        unrelated_of_person: the same as a share of the person's size in the image, because landmark errors in pixels
            grow with the size of the person.
    """

    max_frames: int = 80
    max_shift: int = 30
    max_faults: int = 3
    min_evidence: float = 3.0
    min_evidence_more: float = 12.0
    chance: float = 0.0025
    min_score: float = 1.5
    min_steady: float = 2.5
    min_deviations: float = 4.0
    min_agreed: float = 0.6
    max_spread: float = 0.6
    min_effect: float = 0.6
    min_effect_of_person: float = 0.01
    min_turn_deg: float = 0.2
    min_move: float = 0.02
    min_shift: float = 0.6
    min_focal: float = 0.008
    farthest_turn_deg: float = 6.0
    unrelated: float = 0.04
    unrelated_of_person: float = 0.15


@dataclass(frozen=True)
class Fault:
    """One fault of one camera, or one permutation of video files.

    Attributes:
        kind: kind of fault.
        cameras: name of the camera, or names of all cameras whose files are permuted.
        amount: degrees, metres, frames (positive: the video is late) or relative focal length error; 0 for kinds
            without a size.
        sd: its standard deviation.
        turn_deg: rotation of a camera that was turned or moved, degrees.
        effect_px: median displacement of the camera's 2D points by the fault.
        evidence: log-likelihood gained over the rig without this correction, nats.
        also: other kinds that explain the observations about as well.
        rivals: other cameras that could be the faulty one instead.
        sentence: description of the fault, without advice on what to do.
    """

    kind: Kind
    cameras: tuple[str, ...]
    amount: float
    sd: float
    turn_deg: float
    effect_px: float
    evidence: float
    also: tuple[Kind, ...]
    rivals: tuple[str, ...]
    sentence: str


@dataclass(frozen=True)
class CalibrationDiagnosis:
    """Faults of a rig and how probable each camera is to be faulty.

    Attributes:
        names: (C,) camera names.
        faults: in the order in which they were found, the gravest first; empty for a healthy rig.
        probability: (C,) probability that the camera is faulty, 0 to 1.
        evidence: (C, len(KINDS)) log-likelihood gained by each explanation over the rig as it is, at least 0.
        order: (C,) camera indices by decreasing evidence.
        noise_px: scale of the reprojection errors of the rig as it is.
        corrected_px: the same with all faults corrected.
        cameras: corrected cameras.
        shifts: (C,) delay of each camera's video, frames.
        files: (C,) index of the camera whose file belongs to this camera.
        note: what could not be determined, and why; empty where everything could.
        too_many: whether the search stopped because more than half of the cameras would be faulty.
        doubt: signs of faults that this take does not prove; empty where there are none, or where a fault was found.
    """

    names: tuple[str, ...]
    faults: tuple[Fault, ...]
    probability: FloatArray
    evidence: FloatArray
    order: tuple[int, ...]
    noise_px: float
    corrected_px: float
    cameras: CameraGroup
    shifts: FloatArray
    files: tuple[int, ...]
    note: str = ""
    too_many: bool = False
    doubt: str = ""

    @property
    def sentence(self) -> str:
        """Summary of all faults, without advice on what to do."""
        if self.faults:
            return " ".join([*(f.sentence for f in self.faults), *([self.note] if self.note else [])])
        if self.doubt:
            return self.note or "No camera is proven to be rotated, out of sync, or to have a wrong lens or file."
        return self.note or "All cameras agree: none is rotated, out of sync, or has a wrong lens or file."
