"""Contacts as events of a C3D file and as facts of a record."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from muybridge.motion.contacts.feet import FEET, PARTS
from muybridge.motion.contacts.find import Contacts
from muybridge.motion.contacts.footskate import contact_spans
from muybridge.motion.formats.points.c3d import Event

# Labels and descriptions as gait laboratories write them.
_STRIKE, _OFF = "Foot Strike", "Foot Off"
_TEXT = {
    _STRIKE: "The instant the heel strikes the ground",
    _OFF: "The instant the toe leaves the ground",
}


def contact_events(contacts: Contacts, first_frame: int = 1, subject: str = "") -> tuple[Event, ...]:
    """Where feet begin and cease to stand, in order of time; not at the ends of the take, where that is not known.

    Args:
        contacts: the feet's.
        first_frame: number of the first frame in the recording, from 1, as a C3D counts it.
        subject: the person's name.
    """
    events = []
    for k, side in enumerate(FEET):
        for a, b in contact_spans(contacts.feet[:, k]):
            for frame, label, known in ((a, _STRIKE, a > 0), (b, _OFF, b < len(contacts))):
                if known:
                    time = (frame + first_frame - 1) / contacts.fps
                    events.append(Event(label, time, side.capitalize(), subject, _TEXT[label]))
    return tuple(sorted(events, key=lambda e: e.time))


def contact_facts(contacts: Contacts) -> Mapping[str, Any]:
    """The contacts as plain values: the floor, and seconds from and to which each heel and ball stands."""
    spans = {
        f"{side}_{part}": [
            [round(a / contacts.fps, 4), round(b / contacts.fps, 4)]
            for a, b in contact_spans(contacts.contact[:, k, p])
        ]
        for k, side in enumerate(FEET)
        for p, part in enumerate(PARTS)
    }
    return {
        "floor": {"height_m": round(contacts.floor.height, 4), "normal": np.round(contacts.floor.normal, 5).tolist()},
        "noise_m": round(contacts.noise_m, 4),
        "plates": contacts.plates,
        "seconds": spans,
    }
