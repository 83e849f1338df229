"""Moving objects that are not people: held in front of a body, carried, thrown, displaced, or relit.

If nothing but people moved, a detector that sees the difference to the background would take any moving thing for a
person: a calibration board, an open door, a ball.
"""

from collections.abc import Callable

import cv2
import numpy as np

from muybridge.arrays import BoolArray, ByteArray, FloatArray, IndexArray
from muybridge.train.images.clutter import plain, shape

# Share of scenes in which objects differ from the background model, and in which the light does.
MOVED_SHARE = 0.35
LIT_SHARE = 0.12
# Share of people who hold something in front of them.
HELD_SHARE = 0.16
# Shares of held objects: boards, balls; else bars.
_BOARD, _BALL = 0.6, 0.2
# Shares of boards: squares as for calibration, then pictures; else of one colour.
_SQUARES, _PICTURE = 0.4, 0.4


def move_things(frame: ByteArray, plate: ByteArray, texture: Callable[[], ByteArray], rng: np.random.Generator) -> None:
    """Draw up to three objects of the room into either `frame` or `plate` (H, W, 3): they appeared or disappeared."""
    height, width = plate.shape[:2]
    for _ in range(int(rng.integers(1, 4))):
        inside = shape(height, width, rng)
        cv2.copyTo(texture(), inside, frame if rng.random() < 0.6 else plate)


def light_up(frame: ByteArray, rng: np.random.Generator) -> None:
    """Make part of `frame` (H, W, 3) brighter or darker, as by a lamp, a cloud or an open door."""
    height, width = frame.shape[:2]
    soft = float(np.exp(rng.uniform(np.log(0.5), np.log(20))))
    part = cv2.GaussianBlur(shape(height, width, rng).astype(np.float32), (0, 0), soft)[..., None]
    gain = float(np.exp(rng.uniform(np.log(1.15), np.log(2.2)) * rng.choice([-1, 1])))
    frame[:] = (frame * (1 + (gain - 1) * part)).clip(0, 255).astype(np.uint8)


def hold(frame: ByteArray, mine: BoolArray, texture: Callable[[], ByteArray], rng: np.random.Generator) -> BoolArray:
    """Draw an object that a person holds in front of the body.

    Args:
        frame: (H, W, 3), changed in place.
        mine: (H, W) pixels of the person; a few of them, fingers and arms, stay in front of the object.
        texture: gives an image as large as `frame`.
        rng: source of random numbers.

    Returns:
        (H, W) where the object is.
    """
    height, width = mine.shape
    rows, columns = np.nonzero(mine)
    low, high = np.array([columns.min(), rows.min()]), np.array([columns.max(), rows.max()])
    middle = rng.uniform(low - 0.1 * (high - low), high + 0.1 * (high - low))
    reach = float(np.exp(rng.uniform(np.log(0.06), np.log(0.4)))) * float((high - low).max() + 1)
    kind = rng.random()
    if kind < _BOARD:
        picture, inside = _board(height, width, middle, reach, texture, rng)
    else:
        picture = texture() if rng.random() < 0.5 else plain(height, width, rng)
        inside = np.zeros((height, width), np.uint8)
        if kind < _BOARD + _BALL:
            cv2.circle(inside, _pixel(middle), max(1, round(0.6 * reach)), 1, -1)
        else:
            along = reach * rng.uniform(1, 3) * _direction(rng)
            thick = max(1, round(reach * rng.uniform(0.04, 0.25)))
            cv2.line(inside, _pixel(middle - along), _pixel(middle + along), 1, thick)
    grip = np.zeros((height, width), np.uint8)
    for _ in range(int(rng.integers(0, 4))):
        at = middle + reach * _direction(rng)
        axes = np.maximum(1, reach * rng.uniform(0.1, 0.6, 2)).round().astype(int).tolist()
        cv2.ellipse(grip, _pixel(at), axes, float(rng.uniform(0, 180)), 0, 360, 1, -1)
    there = (inside > 0) & ~((grip > 0) & mine)
    frame[there] = picture[there]
    return there


def cast_shadow(
    frame: ByteArray, alpha: ByteArray, foot: float, shift: IndexArray,
    light: tuple[float, float, float, float],
) -> None:  # fmt: skip
    """Darken the floor where a person blocks the light.

    Args:
        frame: the scene.
        alpha: (h, w) silhouette of the person.
        foot: row of the feet in it.
        shift: of the silhouette in the frame.
        light: shift across and up the image (negative: towards the camera) per pixel of a person's height, the light
            that remains, and the softness of the edges in pixels.
    """
    across, up, left, soft = light
    there = np.array([[1, -across, shift[0] + across * foot], [0, up, shift[1] + (1 - up) * foot]])
    shadow = cv2.warpAffine(alpha, there, (frame.shape[1], frame.shape[0]), flags=cv2.INTER_LINEAR)
    shadow = cv2.GaussianBlur(shadow, (0, 0), soft).astype(np.float32)[..., None] / 255
    frame[:] = (frame * (1 - (1 - left) * shadow)).astype(np.uint8)


def _board(
    height: int, width: int, middle: FloatArray, reach: float, texture: Callable[[], ByteArray],
    rng: np.random.Generator,
) -> tuple[ByteArray, ByteArray]:  # fmt: skip
    """A flat rectangle in a random orientation, whose longer side is twice `reach`: the image (H, W, 3) and its mask
    (H, W)."""
    flat = _face(texture, rng)
    aspect = float(rng.uniform(0.55, 1.0))
    corners = np.array([[-1, -aspect], [1, -aspect], [1, aspect], [-1, aspect]])
    turn = cv2.Rodrigues(np.array([rng.normal(0, 0.5), rng.normal(0, 0.5), rng.normal(0, 0.7)]))[0]
    solid = np.c_[corners, np.zeros(4)] @ turn.T
    seen = middle + reach * solid[:, :2] / (1 + 0.25 * solid[:, 2:])
    side = flat.shape[0]
    to = cv2.getPerspectiveTransform(
        np.array([[0, 0], [side, 0], [side, side], [0, side]], np.float32), seen.astype(np.float32)
    )
    picture = cv2.warpPerspective(flat, to, (width, height), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE)
    inside = np.zeros((height, width), np.uint8)
    cv2.fillConvexPoly(inside, seen.round().astype(np.int32), 1)
    light = rng.uniform(0.35, 1.0)
    return (picture * light).astype(np.uint8), inside


def _face(texture: Callable[[], ByteArray], rng: np.random.Generator) -> ByteArray:
    """(S, S, 3) pattern of a board, with or without a frame."""
    side, kind = 96, rng.random()
    if kind < _SQUARES:
        across, down = rng.integers(3, 9, 2)
        cells = np.indices((down, across)).sum(0) % 2 * 255
        face = cv2.resize(cells.astype(np.uint8), (side, side), interpolation=cv2.INTER_NEAREST)
        if rng.random() < 0.6:  # markers in the white squares
            bits = rng.integers(0, 2, (down * 5, across * 5)).astype(np.uint8) * 255
            marks = cv2.resize(bits, (side, side), interpolation=cv2.INTER_NEAREST)
            face = np.minimum(face, marks)
        face = np.repeat(face[..., None], 3, 2)
    elif kind < _SQUARES + _PICTURE:
        face = cv2.resize(texture(), (side, side), interpolation=cv2.INTER_AREA)
    else:
        face = np.ascontiguousarray(plain(side, side, rng))
    edge = int(rng.integers(0, 10))
    if edge:
        colour = [float(rng.choice([15, 240]))] * 3 if rng.random() < 0.7 else rng.uniform(0, 255, 3).tolist()
        cv2.rectangle(face, (0, 0), (side - 1, side - 1), colour, 2 * edge)
    return np.asarray(face, np.uint8)


def _direction(rng: np.random.Generator) -> FloatArray:
    angle = float(rng.uniform(0, 2 * np.pi))
    return np.array([np.cos(angle), np.sin(angle)])


def _pixel(at: FloatArray) -> tuple[int, int]:
    return int(at[0]), int(at[1])
