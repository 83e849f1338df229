"""Skeletons put into meshes: distance of the joints from the true ones, time and memory.

    python -m scripts.benchmarks.motion.rigging [--bodies 40] [--seed 51] [--characters HERO.glb ...] [--size]
        [--pictures FOLDER] [--network FILE.onnx]

Bodies are anny's in T-, A- and relaxed poses, three of four in clothes (`rig_bodies`); characters are files of artists
whose skin is taken away. Distances are shares of the height. A trunk's middle joints have no agreed place, so what
counts is their distance from the line through the true joints of the trunk; all others are compared one by one.
"""

from __future__ import annotations

import argparse
import resource
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from muybridge.arrays import FloatArray, IntArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.roles import find_roles
from muybridge.infer.networks.characters import RiggerNetwork
from muybridge.motion.character import pose_meshes, read_character
from muybridge.motion.character.rigging import MeshRig, rig_mesh
from muybridge.motion.character.rigging.repair import repair
from muybridge.motion.character.rigging.volume import fill_volume
from scripts.benchmarks.common import DATA, print_header
from scripts.benchmarks.motion.rig_bodies import KnownBody, known_bodies

_ON_LINE = ("spine", "chest", "upper_chest")
_USABLE = 5.0  # percent


@dataclass(frozen=True, eq=False)
class RigScore:
    """What one mesh measures.

    Attributes:
        name: of the mesh.
        errors: role -> percent of the height.
        outside: roles of joints that are not inside the mesh.
        seconds: of one core.
        rig: what was found; None where nothing was.
        why: the message then.
    """

    name: str
    errors: dict[str, float] = field(default_factory=dict)
    outside: tuple[str, ...] = ()
    seconds: float = 0.0
    rig: MeshRig | None = None
    why: str = ""

    @property
    def mean(self) -> float:
        """Percent of the height."""
        return float(np.mean(list(self.errors.values()))) if self.errors else np.nan

    @property
    def worst(self) -> str:
        """The role that is farthest off."""
        return max(self.errors, key=self.errors.__getitem__, default="")


def score(body: KnownBody, network: RiggerNetwork | None = None) -> RigScore:
    """Rig a mesh, and compare."""
    start = time.process_time()
    try:
        rig = rig_mesh(body.vertices, body.triangles, network=network)
    except MuybridgeError as error:
        return RigScore(body.name, why=error.message)
    seconds, matrix = time.process_time() - start, rig.new_from_old
    errors = {}
    line = body.trunk @ matrix[:3, :3].T + matrix[:3, 3]
    for role, place in rig.places.items():
        if role in _ON_LINE:
            errors[role] = 100 * _from_line(place, line) / body.height
        elif role in body.joints:
            true = matrix[:3, :3] @ body.joints[role] + matrix[:3, 3]
            errors[role] = 100 * float(np.linalg.norm(place - true)) / body.height
    return RigScore(body.name, errors, _outside(body, rig), seconds, rig)


def _from_line(point: FloatArray, line: FloatArray) -> float:
    """Metres from a point to the nearest of a line's parts."""
    start, step = line[:-1], np.diff(line, axis=0)
    share = np.clip(((point - start) * step).sum(axis=1) / np.maximum((step**2).sum(axis=1), 1e-12), 0, 1)
    return float(np.linalg.norm(start + share[:, None] * step - point, axis=1).min())


def _outside(body: KnownBody, rig: MeshRig) -> tuple[str, ...]:
    whole = repair(body.vertices @ rig.new_from_old[:3, :3].T + rig.new_from_old[:3, 3], body.triangles)
    volume = fill_volume(whole.vertices, whole.triangles, 160)
    return tuple(r for r, p in rig.places.items() if not volume.inside[tuple(volume.cell_of(p))])


def stripped(path: Path) -> KnownBody:
    """A character's mesh at rest without its skin; rigid parts that hang on it are left out."""
    character = read_character(path)
    meshes = [(m, p[0]) for m, p in zip(character.meshes, pose_meshes(character, character.rest_motion()), strict=True)
              if not m.rigid]  # fmt: skip
    starts = np.cumsum([0, *(len(p) for _, p in meshes)])
    triangles: IntArray = np.concatenate([m.triangles + s for (m, _), s in zip(meshes, starts, strict=False)])
    skeleton = character.skeleton
    roles = find_roles(skeleton, {bone: skeleton.names[j] for bone, j in character.humanoid.items()}).roles
    rest = skeleton.rest_positions + character.root_at_rest
    joints = {role: rest[j] for role, j in roles.items()}
    trunk = np.stack([joints[r] for r in ("hips", "spine", "chest", "upper_chest", "neck", "head") if r in joints])
    vertices = np.concatenate([p for _, p in meshes])
    return KnownBody(path.stem, vertices, triangles, joints, trunk, float(np.ptp(vertices[:, 2])))


def print_scores(scores: list[RigScore], title: str) -> None:
    """A line a mesh, the means, and a table of the joints."""
    print(f"\n## {title}\n")
    print_header(("mesh", "mean %", "worst %", "joint", "outside", "s"))
    for s in scores:
        worst = s.errors.get(s.worst, np.nan)
        print(f"| {s.name} | {s.mean:.2f} | {worst:.2f} | {s.worst or s.why} | {', '.join(s.outside)} | "
              f"{s.seconds:.1f} |", flush=True)  # fmt: skip
    found = [s for s in scores if s.errors]
    usable = sum(max(s.errors.values()) <= _USABLE and not s.outside for s in found)
    print(
        f"\n{len(found)} of {len(scores)} rigged; mean {np.mean([s.mean for s in found]):.2f} %, worst joint "
        f"{max(max(s.errors.values()) for s in found):.2f} %; every joint inside and within {_USABLE:g} %: {usable}\n"
    )
    print_header(("joint", "mean %", "largest %"))
    for role in dict.fromkeys(r for s in found for r in s.errors):
        values = [s.errors[role] for s in found if role in s.errors]
        print(f"| {role} | {np.mean(values):.2f} | {max(values):.2f} |")


def print_sizes(body: KnownBody) -> None:
    """Time and memory on a body of 20,000 vertices, and of two million triangles."""
    print("\n## Size\n")
    print_header(("vertices", "triangles", "s", "peak GB"))
    vertices, triangles = body.vertices, body.triangles
    while True:
        start = time.process_time()
        rig_mesh(vertices, triangles)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        print(
            f"| {len(vertices):,} | {len(triangles):,} | {time.process_time() - start:.1f} | {peak:.2f} |", flush=True
        )
        if len(triangles) > 1_500_000:
            return
        vertices, triangles = _divided(vertices, triangles)


def _divided(vertices: FloatArray, triangles: IntArray) -> tuple[FloatArray, IntArray]:
    """Each triangle as four."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    pairs, number = np.unique(edges, axis=0, return_inverse=True)
    a, b, c = triangles.T
    d, e, f = (number.reshape(-1, 3) + len(vertices)).T
    parts = [np.stack(t, axis=1) for t in ((a, d, f), (d, b, e), (f, e, c), (d, e, f))]
    return np.concatenate([vertices, vertices[pairs].mean(axis=1)]), np.concatenate(parts)


def draw(bodies: list[KnownBody], scores: list[RigScore], path: Path) -> None:
    """A sheet of meshes with the joints that were found (dots) and the true ones (rings), from the front and side."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    columns = 8
    rows = -(-2 * len(bodies) // columns)
    figure, axes = plt.subplots(rows, columns, figsize=(2.6 * columns, 3.6 * rows), squeeze=False)
    for ax in axes.flat:
        ax.set_axis_off()
    for k, (body, found) in enumerate(zip(bodies, scores, strict=True)):
        for n, (i, name) in enumerate(((0, found.name), (1, f"{found.mean:.1f} %"))):
            ax = axes.flat[2 * k + n]
            ax.set_title(name, fontsize=7)
            ax.set_aspect("equal")
            matrix = found.rig.new_from_old if found.rig is not None else np.eye(4)
            points, true = (p @ matrix[:3, :3].T + matrix[:3, 3]
                            for p in (body.vertices[:: max(len(body.vertices) // 6000, 1)],
                                      np.stack(list(body.joints.values()))))  # fmt: skip
            ax.scatter(points[:, i], points[:, 2], s=0.1, c="0.7")
            ax.scatter(true[:, i], true[:, 2], s=14, facecolors="none", edgecolors="g", linewidths=0.7)
            if found.rig is not None:
                joints = found.rig.joints
                for j, parent in enumerate(found.rig.parents):
                    if parent >= 0:
                        ax.plot(joints[[j, parent], i], joints[[j, parent], 2], "b-", lw=0.6)
                ax.scatter(joints[:, i], joints[:, 2], s=5, c="r", zorder=3)
    figure.tight_layout()
    figure.savefig(path, dpi=80)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bodies", type=int, default=40)
    parser.add_argument("--seed", type=int, default=51)
    parser.add_argument("--characters", type=Path, nargs="*", default=sorted((DATA / "characters").glob("*.glb")))
    parser.add_argument("--size", action="store_true", help="measure time and memory on large meshes")
    parser.add_argument("--pictures", type=Path, help="folder for sheets of all meshes with their joints")
    parser.add_argument("--network", type=Path, help="gives a second opinion on the joints")
    args = parser.parse_args()
    network = RiggerNetwork(args.network) if args.network else None
    sets = {"Bodies": list(known_bodies(args.bodies, args.seed)) if args.bodies else []}
    artists = [stripped(path) for path in args.characters if _has_roles(path)]
    sets["Characters"] = artists
    for title, bodies in sets.items():
        if bodies:
            scores = [score(body, network) for body in bodies]
            print_scores(scores, title)
            if args.pictures is not None:
                args.pictures.mkdir(parents=True, exist_ok=True)
                draw(bodies, scores, args.pictures / f"{title.lower()}.png")
    if args.size:
        print_sizes(next(known_bodies(1, args.seed)))


def _has_roles(path: Path) -> bool:
    character = read_character(path)
    return any(not m.rigid for m in character.meshes) and bool(find_roles(character.skeleton).roles)


if __name__ == "__main__":
    main()
