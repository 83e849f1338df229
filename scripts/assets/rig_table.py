"""Fits the table by which the joints of people are estimated from landmarks of their volume.

    python -m scripts.assets.rig_table [--bodies 200] [--seed 2002]

Writes motion/character/rigging/placement/people.npz. The benchmark has bodies of other seeds.
"""

import argparse
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.motion.character.rigging.landmarks import Landmarks, NoBody
from muybridge.motion.character.rigging.placement import features
from muybridge.motion.character.rigging.placement.people import SIDES, SPINE
from muybridge.motion.character.rigging.rig import standing_volume
from scripts.benchmarks.motion.rig_bodies import KnownBody, known_bodies

OUT = Path(__file__).parents[2] / "motion/character/rigging/placement/people.npz"
_RIDGE = 0.02  # of the number of rows, for values of unit spread
Rows = dict[str, list[tuple[FloatArray, FloatArray]]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bodies", type=int, default=200)
    parser.add_argument("--seed", type=int, default=2002)
    args = parser.parse_args()
    rows: Rows = {}
    for body in known_bodies(args.bodies, args.seed):
        add_body(rows, body)
    np.savez(OUT, **fit_table(rows))


def add_body(rows: Rows, body: KnownBody) -> None:
    """Add what is measured on a body, and where its joints are."""
    try:
        marks, matrix = standing_volume(body.vertices, body.triangles)
    except NoBody as error:
        print(f"{body.name}: {error}")
        return
    h = marks.height
    joints = {role: (matrix[:3, :3] @ place + matrix[:3, 3]) / h for role, place in body.joints.items()}
    trunk = (body.trunk @ matrix[:3, :3].T + matrix[:3, 3]) / h
    for k, side in enumerate(SIDES):
        _add_side(rows, marks, {r.removeprefix(f"{side}_"): p * features.MIRROR[k] for r, p in joints.items()
                                if r.startswith(side)}, k)  # fmt: skip
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(trunk, axis=0), axis=1))])
    stop = along[np.argmin(np.linalg.norm(trunk - joints["neck"], axis=1))]
    spine = [np.interp(share * stop, along, trunk[:, a]) for _, share in SPINE for a in (1, 2)]
    _add(rows, "trunk", features.of_trunk(marks), np.array([*spine, *joints["neck"][1:], *joints["head"][1:]]))


def _add_side(rows: Rows, marks: Landmarks, joints: dict[str, FloatArray], k: int) -> None:
    h, way = marks.height, marks.arms[k].way
    back = np.array([0.0, features.chest_depth(marks) / h, 0.0])
    values = features.of_arm(marks, k)
    _add(rows, "shoulder", values, joints["upper_arm"] - back)
    _add(rows, "clavicle", values, joints["clavicle"] - back)
    points = way.points * features.MIRROR[k] / h
    nearest = [way.along[np.argmin(np.linalg.norm(points - joints[part], axis=1))] / h for part in ("forearm", "hand")]
    _add(rows, "arm", values, np.array(nearest))
    hip = float(joints["thigh"][2])
    _add(rows, "hip", features.of_hip(marks, k), joints["thigh"][2:])
    _add(rows, "thigh", features.of_thigh(marks, k, hip), joints["thigh"][:2])
    _add(rows, "shin", features.of_shin(marks, k, hip), joints["shin"])
    _add(rows, "foot", features.of_foot(marks, k), np.concatenate([joints["foot"], joints["toe"]]))


def _add(rows: Rows, name: str, values: FloatArray, wanted: FloatArray) -> None:
    rows.setdefault(name, []).append((values, wanted))


def fit_table(rows: Rows) -> dict[str, FloatArray]:
    """Name -> (1 + N, M): constants, and factors of the N values for each of M numbers, by ridge regression."""
    out = {}
    for name, pairs in rows.items():
        values, wanted = (np.array([pair[k] for pair in pairs]) for k in (0, 1))
        middle, spread = values.mean(axis=0), values.std(axis=0) + 1e-6
        scaled = (values - middle) / spread
        centred = wanted - wanted.mean(axis=0)
        normal = scaled.T @ scaled + _RIDGE * len(scaled) * np.eye(scaled.shape[1])
        factors = np.linalg.solve(normal, scaled.T @ centred) / spread[:, None]
        table = np.concatenate([(wanted.mean(axis=0) - middle @ factors)[None], factors])
        error = np.linalg.norm(wanted - table[0] - values @ table[1:], axis=1)
        print(f"{name}: mean {100 * error.mean():.2f} %, 95 % {100 * np.quantile(error, 0.95):.2f} % of the height")
        out[name] = table.astype(np.float32)
    return out


if __name__ == "__main__":
    main()
