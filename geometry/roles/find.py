"""Roles of any skeleton: by the user's map, by the file's own table, by names, else by geometry."""

from collections.abc import Mapping

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.roles.geometric import Body, find_by_geometry
from muybridge.geometry.roles.names import roles_by_profile, roles_by_words, sides_by_names
from muybridge.geometry.roles.one_piece import one_piece_limbs
from muybridge.geometry.roles.role_map import CORE_ROLES, LIMBS, RoleMap, in_order, joints_of_map
from muybridge.geometry.roles.tree import build_tree
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.profiles import PROFILES, ROLES
from muybridge.geometry.skeleton.skeleton import Skeleton

_MOST_POSES = 24  # of a motion that are looked at
_FROM_VRM = {bone.lower(): role for role, bone in PROFILES["vrm"].items()}


def find_roles(
    skeleton: Skeleton,
    names_table: Mapping[str, str] | None = None,
    map: Mapping[str, str] | None = None,
    positions: FloatArray | None = None,
) -> RoleMap:
    """Which joint has which role of a human body.

    A map counts before the file's own table, that before the names of a known program, and these before geometry, which
    looks at no names; a table or names that do not fit the tree (a thigh below a hand) are passed over. Animals on four
    legs are recognised and have no roles, whatever their joints are called.

    Args:
        skeleton: in any units, with any axis up, facing anywhere.
        names_table: role, or bone of the VRM humanoid, -> joint, as the file itself states it.
        map: role -> joint, which a user wrote; it is complete: nothing else is looked for.
        positions: (T, J, 3) of a motion, which geometry judges where the rest pose is no standing body.

    Raises:
        MuybridgeError: the map names a role or joint that does not exist, or gives a joint two roles.
    """
    if map:
        return RoleMap(joints_of_map(skeleton, map), "map", "human")
    told = _of_table(skeleton, names_table or {})
    if told:
        return RoleMap(told, "vrm", "human")
    profile, named = roles_by_profile(skeleton)
    body = find_by_geometry(skeleton, positions)
    if body.kind == "quadruped":
        return RoleMap({}, "none", "quadruped")
    if _complete(named):
        return RoleMap(named, f"names:{profile}", "human")
    spoken = roles_by_words(skeleton)
    if _complete(spoken) and body.kind == "human":
        return RoleMap(_with_rest(spoken, body.roles), "names:words", "human")
    if body.kind == "human":
        return _of_geometry(skeleton, body)
    if named:
        return RoleMap(named, f"names:{profile}", "human")
    limbs = one_piece_limbs(build_tree(skeleton)) if body.kind == "other" else None
    if limbs is not None:
        notes = (f"{part}: {skeleton.names[a]}, {skeleton.names[b]}"
                 for part, (a, b) in zip(("legs", "arms"), limbs, strict=True))  # fmt: skip
        return RoleMap({}, "none", "one piece", tuple(notes))
    return RoleMap({}, "none", body.kind)


def find_motion_roles(
    motion: Motion, names_table: Mapping[str, str] | None = None, map: Mapping[str, str] | None = None
) -> RoleMap:
    """The roles of a motion's joints, for which some of its poses count where the rest pose is no standing body.

    Args:
        motion: Z up.
        names_table: as of `find_roles`.
        map: as of `find_roles`.

    Raises:
        MuybridgeError: as `find_roles`.
    """
    frames = np.unique(np.linspace(0, max(len(motion) - 1, 0), _MOST_POSES).astype(np.intp))
    positions = motion.select(frames).joint_positions_world() if len(motion) > 1 else None
    return find_roles(motion.skeleton, names_table, map, positions)


def _complete(roles: Mapping[str, int]) -> bool:
    return all(role in roles for role in CORE_ROLES)


def _of_table(skeleton: Skeleton, table: Mapping[str, str]) -> dict[str, int]:
    """The roles of a file's own table; empty where it does not fit the tree."""
    known = {name: j for j, name in enumerate(skeleton.names)}
    out = {}
    for key, name in table.items():
        role = key if key in ROLES else _FROM_VRM.get(key.lower(), "")
        if role and name in known:
            out[role] = known[name]
    fits = {"hips", "left_thigh", "right_thigh"} <= set(out) and in_order(skeleton, out)
    return out if fits else {}


def _with_rest(roles: dict[str, int], others: Mapping[str, int]) -> dict[str, int]:
    """Roles completed by those of another source, where that has the same limbs and the joints are free."""
    out = dict(roles)
    shared = [role for role in CORE_ROLES if role in others]
    if np.mean([roles[role] == others[role] for role in shared]) > 0.5:
        taken = set(out.values())
        out |= {role: j for role, j in others.items() if role not in out and j not in taken}
    return out


def _of_geometry(skeleton: Skeleton, body: Body) -> RoleMap:
    """Roles by geometry, with the sides that the names state where all agree."""
    roles, notes = body.roles, list(body.notes)
    parts = [part for part in LIMBS if f"left_{part}" in roles and f"right_{part}" in roles]
    left, right = ([roles[f"{side}_{part}"] for part in parts] for side in ("left", "right"))
    told = sides_by_names(skeleton.names, left, right)
    if told is False:
        roles = {_other_side(role): j for role, j in roles.items()}
        notes.append("left and right were taken from the names")
    elif told:
        notes = []
    return RoleMap(roles, "geometry", "human", tuple(notes))


def _other_side(role: str) -> str:
    if role.startswith("left_"):
        return "right_" + role.removeprefix("left_")
    return "left_" + role.removeprefix("right_") if role.startswith("right_") else role
