"""The networks on photographs of people with labelled joints: landmarks in given boxes, and people in whole pictures.

Usage: python -m scripts.benchmarks.networks.photographs [DATA] [--network NETWORK.onnx] [--people NETWORK.onnx]
           [--sheet PATH]

DATA, by default `../shared/data/photographs`, has the pictures and `people.json`: a list of people with `image`, `bbox`
(x, y, width, height), `joints` (name to x, y) and `set`. People are read as in a take, mirrored and turned where they
look uncertain, without calibration and background. PCK@x is the share of labelled joints within x of the trunk (centre
of the shoulders to centre of the hips, as in scripts.benchmarks.takes.mediapipe); people whose trunk is not labelled do
not count. A joint on the other side is more than 0.2 trunks off and less than half as far from its left-right twin. A
withheld joint has no position. Shares within one and two standard deviations are per coordinate, of joints that have
one. `--sheet` writes a contact sheet, which belongs outside of the repository.
"""

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from muybridge.api.networks import ImageLandmarks, KeypointNetwork, PersonDetector
from muybridge.arrays import BoolArray, ByteArray, FloatArray
from muybridge.geometry.landmarks.sets import BODY23
from muybridge.infer.detection.tracker import TrackOptions
from scripts.benchmarks.common import DATA, JOINTS, print_header

OVERLAP = 0.5  # of boxes, intersection over union
TILE = 320  # side of a picture on the sheet, px
COLUMNS = 7
JOINT = np.array([BODY23.index(name) for name in JOINTS])
TWIN = np.array(BODY23.mirror)[JOINT]


class Person(NamedTuple):
    """A labelled person.

    Attributes:
        image: RGB.
        box: (4,) left, top, right, bottom, px.
        joints: (12, 2) `JOINTS`, px; NaN where not labelled.
    """

    image: ByteArray
    box: FloatArray
    joints: FloatArray

    @property
    def trunk(self) -> float:
        """Centre of the shoulders to centre of the hips, px; NaN where one of them is not labelled."""
        left, right = self.joints[::2], self.joints[1::2]  # of shoulders, elbows, wrists, hips, ...
        middle = np.where(np.isnan(left), right, np.where(np.isnan(right), left, (left + right) / 2))
        return float(np.linalg.norm(middle[0] - middle[3]))


class Score(NamedTuple):
    """Figures of labelled joints; see the module."""

    at_two: float
    at_five: float
    other_side: float
    withheld: float
    one_sigma: float
    two_sigma: float


Change = Callable[[Person], Person]


def load_people(folder: Path) -> list[tuple[str, Person]]:
    """The people by the names of their pictures."""
    pictures: dict[str, ByteArray] = {}
    people = []
    for entry in json.loads((folder / "people.json").read_text()):
        name = entry["image"]
        if name not in pictures:
            pictures[name] = np.ascontiguousarray(cv2.imread(str(folder / name))[..., ::-1])
        x, y, width, height = entry["bbox"]
        joints = np.array([entry["joints"].get(joint, [np.nan, np.nan]) for joint in JOINTS], dtype=np.float64)
        people.append((name, Person(pictures[name], np.array([x, y, x + width, y + height]), joints)))
    return people


def grey(person: Person) -> Person:
    """The person in a picture without colour."""
    return person._replace(image=np.repeat(cv2.cvtColor(person.image, cv2.COLOR_RGB2GRAY)[..., None], 3, 2))


def scaled_box(person: Person, factor: float) -> Person:
    """The person with a box of another size about the same centre."""
    middle, half = (person.box[:2] + person.box[2:]) / 2, (person.box[2:] - person.box[:2]) / 2 * factor
    return person._replace(box=np.concatenate([middle - half, middle + half]))


def score(people: list[Person], found: list[ImageLandmarks]) -> Score:
    """Figures of the landmarks found in each person's box."""
    labelled = np.stack([p.joints for p in people])
    trunk = np.array([p.trunk for p in people])[:, None]
    points, sd = np.concatenate([f.points_px for f in found]), np.concatenate([f.sd_px for f in found])[:, JOINT]
    counted = np.isfinite(labelled).all(-1) & np.isfinite(trunk)
    error = points[:, JOINT] - labelled
    away = np.linalg.norm(error, axis=-1) / trunk
    known = np.isfinite(away)
    away = np.where(known, away, np.inf)
    other = known & (away > 0.2) & (np.linalg.norm(points[:, TWIN] - labelled, axis=-1) / trunk < away / 2)
    sigmas = np.abs(error[counted & known]) / sd[counted & known][:, None]
    shares = (those[counted].mean() for those in (away < 0.2, away < 0.5, other, ~known))
    return Score(*map(float, shares), float((sigmas < 1).mean()), float((sigmas < 2).mean()))


def read(network: KeypointNetwork, people: list[Person]) -> list[ImageLandmarks]:
    """The landmarks in each person's box."""
    return [network.locate(person.image, person.box[None]) for person in people]


def overlap(boxes: FloatArray, others: FloatArray) -> FloatArray:
    """(K, M) intersection over union of boxes (K, 4) and (M, 4)."""
    low, high = np.maximum(boxes[:, None, :2], others[:, :2]), np.minimum(boxes[:, None, 2:], others[:, 2:])
    both = np.clip(high - low, 0, None).prod(-1)
    area, other_area = ((b[:, 2:] - b[:, :2]).prod(-1) for b in (boxes, others))
    return np.asarray(both / (area[:, None] + other_area - both))


def match(boxes: FloatArray, labelled: FloatArray) -> tuple[BoolArray, BoolArray]:
    """Which of the detected boxes (K, 4), best first, and of the labelled ones (M, 4) belong together: (K,), (M,)."""
    same = overlap(boxes, labelled)
    used, taken = np.zeros(len(boxes), dtype=np.bool_), np.zeros(len(labelled), dtype=np.bool_)
    for row in range(len(boxes)):
        free = np.where(taken, 0.0, same[row])
        if len(free) and free.max() >= OVERLAP:
            used[row] = taken[free.argmax()] = True
    return used, taken


def detection(detector: PersonDetector, people: list[tuple[str, Person]]) -> tuple[float, int]:
    """Share of the labelled people who are detected, and the number of boxes on nobody who is labelled."""
    hit, count, spare = 0, 0, 0
    for name in dict.fromkeys(name for name, _ in people):
        there = [person for each, person in people if each == name]
        height, width = there[0].image.shape[:2]
        labelled = np.clip([person.box for person in there], 0, [width, height, width, height])
        used, taken = match(detector.detect(there[0].image).boxes_px, labelled)
        hit, count, spare = hit + int(taken.sum()), count + len(taken), spare + int((~used).sum())
    return hit / count, spare


def draw(person: Person, found: ImageLandmarks) -> ByteArray:
    """A tile of the sheet: the box's surroundings, the skeleton (left blue, right orange, middle white; thin where the
    standard deviation exceeds a fifth of the trunk) and the labels as green rings."""
    side = 1.3 * float((person.box[2:] - person.box[:2]).max())
    corner, scale = (person.box[:2] + person.box[2:] - side) / 2, TILE / side
    affine = np.array([[scale, 0, -scale * corner[0]], [0, scale, -scale * corner[1]]])
    tile = cv2.warpAffine(person.image, affine, (TILE, TILE), flags=cv2.INTER_AREA)
    at, sure = (found.points_px[0] - corner) * scale, found.sd_px[0] < 0.2 * np.nan_to_num(person.trunk, nan=side / 5)
    for names in BODY23.edges:
        a, b = map(BODY23.index, names)
        if np.isfinite(at[[a, b]]).all():
            sides = {name.split("_")[0] for name in names}
            colour = (90, 160, 255) if sides == {"left"} else (255, 150, 40) if sides == {"right"} else (255, 255, 255)
            cv2.line(tile, *(tuple(int(v) for v in at[k]) for k in (a, b)), colour, 2 if sure[[a, b]].all() else 1)
    for joint in (person.joints - corner) * scale:
        if np.isfinite(joint).all():
            cv2.circle(tile, (int(joint[0]), int(joint[1])), 4, (0, 230, 0), 1, cv2.LINE_AA)
    return np.asarray(tile, dtype=np.uint8)


def write_sheet(path: Path, people: list[Person], found: list[ImageLandmarks]) -> None:
    """The contact sheet."""
    tiles = [draw(person, one) for person, one in zip(people, found, strict=True)]
    tiles += [np.zeros_like(tiles[0])] * (-len(tiles) % COLUMNS)
    rows = [np.concatenate(tiles[k : k + COLUMNS], 1) for k in range(0, len(tiles), COLUMNS)]
    cv2.imwrite(str(path), np.concatenate(rows)[..., ::-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, nargs="?", default=DATA / "photographs")
    parser.add_argument("--network", type=Path)
    parser.add_argument("--people", type=Path)
    parser.add_argument("--sheet", type=Path)
    options = parser.parse_args()
    if not (options.data / "people.json").is_file():
        raise SystemExit(f"{options.data}: no people.json there, nothing to score")
    people = load_people(options.data)
    network = KeypointNetwork(options.network)
    changes: dict[str, Change] = {
        "as labelled": lambda p: p, "without colour": grey, "15 % tighter": lambda p: scaled_box(p, 0.85),
        "15 % looser": lambda p: scaled_box(p, 1.15), "20 % looser": lambda p: scaled_box(p, 1.2),
    }  # fmt: skip
    print_header(["boxes", "PCK@0.2", "PCK@0.5", "other side", "withheld", "within 1 sd", "within 2 sd"])
    for name, change in changes.items():
        changed = [change(person) for _, person in people]
        found = read(network, changed)
        print(f"| {name} | {' | '.join(f'{value:.3f}' for value in score(changed, found))} |", flush=True)
        if options.sheet is not None and name == "as labelled":
            write_sheet(options.sheet, changed, found)
    start = TrackOptions().start_score
    recall, spare = detection(PersonDetector(options.people, min_confidence=start), people)
    print(f"\nDetector at {start:.2f}: {recall:.3f} of {len(people)} people, {spare} boxes on nobody who is labelled")


if __name__ == "__main__":
    main()
