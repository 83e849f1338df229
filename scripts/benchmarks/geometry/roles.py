"""Roles of joints by geometry alone, every name scrambled: generated bodies, and files whose own names are the truth.

python -m scripts.benchmarks.geometry.roles [FILE ...] [--bodies 20]
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from muybridge.geometry.roles import CORE_ROLES, RoleMap, find_roles
from muybridge.motion.formats.registry import read_file
from tests.geometry.roles.bodies import HABITS, four_legged, human, lower_arms


def right_roles(found: RoleMap, truth: dict[str, int]) -> int:
    """Of the core roles, how many are right."""
    return sum(found.roles.get(role) == truth[role] for role in CORE_ROLES)


def exchanged(found: RoleMap, truth: dict[str, int]) -> bool:
    """Whether a joint of one side has its role on the other."""
    other = {"left": "right", "right": "left"}
    pairs = [(role, f"{other[role.split('_')[0]]}_{role.split('_', 1)[1]}") for role in CORE_ROLES[1:]]
    return any(found.roles.get(role) == truth[mirrored] for role, mirrored in pairs)


def score_bodies(count: int) -> None:
    """Bodies of each maker's habits in T-pose, A-pose and with arms down, turned any way, in three units."""
    right = swapped = 0
    for options in HABITS.values():
        for seed in range(count):
            rng = np.random.default_rng(seed)
            chosen = {"legs": rng.uniform(0.85, 1.15), "arms": rng.uniform(0.9, 1.1)} | options
            body = lower_arms(human(rng, **chosen), (0, 45, 80)[seed % 3])
            skeleton, truth = body.build(Rotation.random(random_state=seed), (1, 100, 0.01)[seed % 3], rng)
            found = find_roles(skeleton)
            right, swapped = right + right_roles(found, truth), swapped + exchanged(found, truth)
    animals = [find_roles(four_legged(np.random.default_rng(k)).build(Rotation.random(random_state=k))[0]).kind
               for k in range(count)]  # fmt: skip
    bodies = count * len(HABITS)
    print(f"{bodies} bodies: {right} of {bodies * len(CORE_ROLES)} roles, sides exchanged in {swapped}; "
          f"{animals.count('quadruped')} of {count} animals recognised")  # fmt: skip


def score_file(path: Path) -> None:
    """One file, with its names and without."""
    motion = read_file(path).motion
    places = motion.joint_positions_world()
    named = find_roles(motion.skeleton, positions=places)
    scrambled = replace(motion.skeleton, names=tuple(f"joint{k}" for k in range(len(motion.skeleton))))
    found = find_roles(scrambled, positions=places)
    if not named.roles:
        print(f"{path.name}: {named.kind}, without names {found.kind}")
        return
    print(f"{path.name}: by {named.how}; without names {right_roles(found, named.roles)} of {len(CORE_ROLES)}, "
          f"sides exchanged: {'yes' if exchanged(found, named.roles) else 'no'}")  # fmt: skip


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", type=Path, nargs="*")
    parser.add_argument("--bodies", type=int, default=20)
    arguments = parser.parse_args()
    for path in arguments.files:
        score_file(path)
    score_bodies(arguments.bodies)


if __name__ == "__main__":
    main()
