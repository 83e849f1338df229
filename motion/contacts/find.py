"""Which heels and balls of the feet stand on the floor, and when."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from muybridge.arrays import BoolArray, FloatArray
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.skeleton.motion import Motion
from muybridge.motion.contacts.feet import FootPoints, feet_of_motion, feet_of_points
from muybridge.motion.contacts.floor import Floor, find_floor
from muybridge.motion.contacts.footskate import contact_spans
from muybridge.motion.contacts.plates import plate_loads, weigh_feet
from muybridge.motion.contacts.probability import SHIFT_S, standing_probability
from muybridge.motion.formats.points.c3d import C3DTake

_PIECE_S = 0.2  # a shorter piece of a contact that was cut is no contact
_STEP_M = 0.004  # of the heights at which heels and balls rest, in judging contacts: a third of how they vary
_HIGHEST_M = 0.08  # that heels and balls are over a floor that is known


@dataclass(frozen=True)
class ContactOptions:
    """How contacts are found; lengths are of an adult, and scaled by the length of the legs.

    Attributes:
        floor: the floor where it is known; None finds it.
        slope: whether a floor that is found may slope.
        enter: probability from which a contact begins.
        leave: probability under which it ends.
        shortest: seconds of a contact, and of the gap between two of one point; shorter ones are dropped.
        height: metres over where it rests that a point stands no more, besides noise.
        creep: metres that a point may be from the middle of its contact, besides the noise; a contact is cut where it
            moves the fastest until none is.
        smoothing: seconds, standard deviation of a Gaussian over the positions before velocities are taken.
    """

    floor: Floor | None = None
    slope: bool = False
    enter: float = 0.5
    leave: float = 0.4
    shortest: float = 0.06
    height: float = 0.045
    creep: float = 0.025
    smoothing: float = 0.025


@dataclass(frozen=True, eq=False)
class Contacts:
    """Heels and balls of the feet on the floor.

    Attributes:
        contact: (T, 2, 2) whether heel and ball of the left and the right foot stand.
        fps: frames per second.
        floor: what they stand on.
        probability: (T, 2, 2) that they do.
        clearance: (2, 2) metres of heel and ball over the floor while they stand.
        noise_m: metres, standard deviation of a coordinate that was assumed; 0 where contacts are given.
        plates: number of force plates that were used.
    """

    contact: BoolArray
    fps: float
    floor: Floor = field(default_factory=Floor)
    probability: FloatArray = field(default_factory=lambda: np.zeros((0, 2, 2)))
    clearance: FloatArray = field(default_factory=lambda: np.full((2, 2), np.nan))
    noise_m: float = 0.0
    plates: int = 0

    def __len__(self) -> int:
        return len(self.contact)

    @property
    def feet(self) -> BoolArray:
        """(T, 2) whether the left and the right foot stand, on heel or ball."""
        return np.asarray(self.contact.any(-1))

    @classmethod
    def of_feet(
        cls, standing: BoolArray, fps: float, floor: Floor | None = None, clearance: FloatArray | None = None
    ) -> "Contacts":
        """Contacts that are known beforehand.

        Args:
            standing: (T, 2) of whole feet, or (T, 2, 2) of heels and balls.
            fps: frames per second.
            floor: what they stand on; None for z = 0.
            clearance: (2, 2) metres of heels and balls over it while they stand; None, or NaN, goes by their medians.

        Raises:
            ValueError: another shape.
        """
        standing = np.asarray(standing, dtype=np.bool_)
        if standing.shape[1:] not in ((2,), (2, 2)):
            raise ValueError(f"contacts must be (T, 2) or (T, 2, 2), not {standing.shape}")
        both = np.repeat(standing[..., None], 2, -1) if standing.ndim == 2 else standing
        known = np.full((2, 2), np.nan) if clearance is None else np.asarray(clearance, dtype=np.float64)
        return cls(both, fps, floor or Floor(), both.astype(np.float64), known)


def find_contacts(
    source: Motion | Points3D,
    options: ContactOptions | None = None,
    *,
    roles: Mapping[str, int] | None = None,
    plates: C3DTake | None = None,
) -> Contacts:
    """Heels and balls on the floor, of a motion or of labelled points.

    Args:
        source: Z up.
        options: how they are found.
        roles: of a motion's joints, role -> index; None finds them.
        plates: the file's force plates: where a foot is over one, it stands while the plate is loaded.

    Raises:
        ValueError: legs, or heels and toes, are not known; another number of frames than the plates have.
    """
    options = options or ContactOptions()
    feet = feet_of_motion(source, roles) if isinstance(source, Motion) else feet_of_points(source)
    smooth, known = _smoothed(feet, options.smoothing)
    velocity = _velocity(smooth, known, feet.fps)
    shift = _shift(smooth, known, round(SHIFT_S * feet.fps))
    speed = np.linalg.norm(velocity, axis=-1)
    floor, clearance = find_floor(feet, speed, options.slope)
    if options.floor is not None:
        clearance = clearance + (floor.height - options.floor.height) * floor.normal[2]
        clearance = np.clip(clearance, 0, _HIGHEST_M * feet.size)
        floor = options.floor
    # To steps: a frame more or less elsewhere in the take does not move where a contact begins.
    step = _STEP_M * feet.size
    heights = floor.heights(feet.places) - clearance
    heights = heights + _remainder(clearance + floor.height * floor.normal[2], step)
    found, noise = _probability(feet, heights, velocity, shift)
    loads = plate_loads(plates) if plates is not None else ()
    weighed = [weigh_feet(found, feet.places, load) for load in loads]
    none = np.zeros(found.shape, np.bool_)
    stands, free = (np.logical_or.reduce([none, *(each[k] for each in weighed)]) for k in (0, 1))
    found = np.where(free & ~stands, 0.0, found)
    contact = np.zeros(found.shape, np.bool_)
    for k in range(2):
        for p in range(2):
            held = _with_hysteresis(found[:, k, p], options, feet.fps)
            held &= ~(heights[:, k, p] > options.height * feet.size + noise)
            most = options.creep * feet.size + noise
            still = _still(held, smooth[:, k, p], most, round(_PIECE_S * feet.fps))
            contact[:, k, p] = without_short_runs(still, round(options.shortest * feet.fps))
    found = np.where(stands, 1.0, found)
    return Contacts(contact | stands, feet.fps, floor, found, clearance, noise, len(loads))


def _remainder(heights: FloatArray, step: float) -> FloatArray:
    """What is left of heights beyond whole steps."""
    return np.asarray(heights - np.round(heights / step) * step)


def _probability(
    feet: FootPoints, heights: FloatArray, velocity: FloatArray, shift: FloatArray
) -> tuple[FloatArray, float]:
    """(T, 2, 2) that heels and balls stand, and the noise that was assumed."""
    flat = (len(heights), 4)
    found, noise = standing_probability(heights.reshape(flat), velocity.reshape(*flat, 3), shift.reshape(flat),
                                        feet.sigma.reshape(flat), feet.fps, feet.size)  # fmt: skip
    return found.reshape(heights.shape), noise


def without_short_runs(contact: BoolArray, shortest: int) -> BoolArray:
    """(T,) with gaps between contacts, and then contacts, of less than `shortest` frames dropped; not at the ends."""
    out = contact.copy()
    for value in (False, True):
        for a, b in contact_spans(out == value):
            if b - a < shortest and a > 0 and b < len(out):
                out[a:b] = not value
    return out


def with_floor(contacts: Contacts, feet: FootPoints) -> Contacts:
    """Contacts that know how high the points are over the floor where they stand: by their medians there."""
    floor, clearance = contacts.floor, contacts.clearance.copy()
    for k in range(2):
        for p in range(2):
            standing = contacts.contact[:, k, p]
            if not np.isfinite(clearance[k, p]) and standing.any():
                clearance[k, p] = np.nanmedian(floor.heights(feet.places[standing, k, p]))
    for p in range(2):  # one that never stands is as high as the other foot's, or as the other point
        known = clearance[:, p][np.isfinite(clearance[:, p])]
        other = clearance[:, 1 - p][np.isfinite(clearance[:, 1 - p])]
        usual = float(known.mean()) if len(known) else float(other.mean()) if len(other) else 0.0
        clearance[:, p] = np.where(np.isfinite(clearance[:, p]), clearance[:, p], usual)
    return replace(contacts, clearance=clearance)


def _smoothed(feet: FootPoints, smoothing: float) -> tuple[FloatArray, BoolArray]:
    """(T, 2, 2, 3) metres with gaps bridged, and (T, 2, 2) where there was none."""
    known = np.asarray(np.isfinite(feet.places).all(-1))
    filled = np.where(known[..., None], feet.places, _bridged(feet.places, known))
    return gaussian_filter1d(filled, max(smoothing * feet.fps, 1e-3), axis=0, mode="nearest"), known


def _velocity(smooth: FloatArray, known: BoolArray, fps: float) -> FloatArray:
    """(T, 2, 2, 3) metres per second; NaN where the point is not known."""
    velocity = np.gradient(smooth, axis=0) * fps if len(smooth) > 1 else np.zeros_like(smooth)
    return np.where(known[..., None], velocity, np.nan)


def _shift(smooth: FloatArray, known: BoolArray, frames: int) -> FloatArray:
    """(T, 2, 2) metres that a point moves in so many frames before or after, whichever is less."""
    before, after = np.full(known.shape, np.inf), np.full(known.shape, np.inf)
    step = min(max(frames, 1), len(smooth) - 1)
    if step < 1:
        return np.where(known, 0.0, np.nan)
    before[step:] = after[:-step] = np.linalg.norm(smooth[step:] - smooth[:-step], axis=-1)
    least = np.minimum(before, after)
    return np.where(known, np.where(np.isfinite(least), least, 0.0), np.nan)


def _bridged(places: FloatArray, known: BoolArray) -> FloatArray:
    """The places with gaps bridged by straight lines."""
    out, frames = places.copy(), np.arange(len(places))
    for index in np.ndindex(*known.shape[1:]):
        there = known[(slice(None), *index)]
        for axis in range(3):
            column = places[(slice(None), *index, axis)]
            out[(slice(None), *index, axis)] = np.interp(frames, frames[there], column[there]) if there.any() else 0.0
    return out


def _with_hysteresis(probability: FloatArray, options: ContactOptions, fps: float) -> BoolArray:
    """(T,) whether a point stands."""
    out = np.zeros(len(probability), np.bool_)
    for a, b in contact_spans(probability >= options.leave):
        out[a:b] = bool((probability[a:b] >= options.enter).any())
    return without_short_runs(out, round(options.shortest * fps))


def _still(contact: BoolArray, places: FloatArray, most: float, shortest: int) -> BoolArray:
    """(T,) the contacts, cut into pieces in which a point (T, 3) stays within `most` metres of its median place."""
    out, open_spans = contact.copy(), [(a, b, False) for a, b in contact_spans(contact)]
    while open_spans:
        a, b, is_piece = open_spans.pop()
        if is_piece and b - a < shortest:
            out[a:b] = False
            continue
        away = np.linalg.norm(places[a:b] - np.median(places[a:b], axis=0), axis=1)
        if away.max() <= most or b - a < 3:
            continue
        cut = a + 1 + int(np.argmax(np.linalg.norm(np.diff(places[a:b], axis=0), axis=1)))
        left, right = max(cut - shortest // 8, a), min(cut + max(shortest // 8, 1), b)
        out[left:right] = False
        open_spans += [(c, d, True) for c, d in ((a, left), (right, b)) if c < d]
    return out
