"""Options of tracking people in 3D over several cameras."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TrackingOptions:
    """How detections of several cameras are associated to people.

    A body size is the longer side of the bounding box of a person's landmarks.

    Attributes:
        gate: largest distance of a detection from the predicted projection of a body, in body sizes.
        gate_growth: growth of the gate per second in which no camera saw the body, in body sizes.
        gate_slack: growth of the gate per second of frame interval beyond 1/30 s, in body sizes: between frames that
            are farther apart, people move farther.
        start: largest distance of two views' rays, in body sizes, at which the views may start a body.
        odd_view: distance of a view's rays from a body, in body sizes, from which the view is rejected where the
            others agree well without it.
        min_frames: people seen by two cameras in fewer frames are dropped as false positives; so are people seen for
            less than 0.3 s at a time or less than 0.5 s in total (1 s where no third camera ever sees them).
        coast: time for which a body is predicted without observations before it ends, seconds.
        same_build: largest mean relative difference of limb lengths at which a person who reappears is identified
            with one who disappeared.
    """

    gate: float = 0.12
    gate_growth: float = 0.45
    gate_slack: float = 0.5
    start: float = 0.06
    odd_view: float = 0.05
    min_frames: int = 5
    coast: float = 1.0
    same_build: float = 0.04
