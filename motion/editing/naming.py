"""Names of another program for the joints of a motion."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from muybridge.errors import MuybridgeError
from muybridge.geometry.roles import CORE_ROLES, find_motion_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.profiles import PROFILES


def new_names(motion: Motion, profile: str, roles: Mapping[str, int] | None = None) -> dict[str, str]:
    """Old name -> new name, of the joints that have a role.

    Raises:
        MuybridgeError: as `rename_joints`.
    """
    if profile not in PROFILES:
        raise MuybridgeError(f"no set of names {profile!r}: choose one of {', '.join(PROFILES)}")
    names = motion.skeleton.names
    roles = find_motion_roles(motion).roles if roles is None else roles
    if not roles:
        raise MuybridgeError("the roles of the joints are not known, neither by their names nor by the shape of the "
                             "skeleton, so that none can be renamed; the joints are "
                             f"{', '.join(names[:12])}{' ...' if len(names) > 12 else ''}")  # fmt: skip
    table = PROFILES[profile]
    if all(names[roles[role]] == table[role] for role in CORE_ROLES if role in roles and role in table):
        # Named so already. Which joint of several in the spine is which depends on their names: they keep them.
        return {name: name for name in names if name in table.values()}
    return {names[j]: table[role] for role, j in roles.items() if role in table}


def displaced_names(names: Sequence[str], new: Mapping[str, str]) -> dict[str, str]:
    """Old name -> free name, of joints whose name another joint gets.

    Args:
        names: of all joints.
        new: old name -> new name, as `new_names` gives it.
    """
    used, out = {*names, *new.values()}, {}
    for name in names:
        if name in new or name not in new.values():
            continue
        k = 2
        while f"{name}_{k}" in used:
            k += 1
        out[name] = f"{name}_{k}"
        used.add(out[name])
    return out


def rename_joints(motion: Motion, profile: str, roles: Mapping[str, int] | None = None) -> Motion:
    """The motion with the joint names of another program.

    Joints that have no name there keep theirs, unless another joint gets it: then a number is put behind it.

    Args:
        motion: of a human body.
        profile: a key of `muybridge.geometry.skeleton.PROFILES`.
        roles: role -> joint; None finds them.

    Raises:
        MuybridgeError: an unknown profile, or joints of unknown roles.
    """
    new = new_names(motion, profile, roles)
    skeleton = motion.skeleton
    new |= displaced_names(skeleton.names, new)
    return replace(motion, skeleton=replace(skeleton, names=tuple(new.get(name, name) for name in skeleton.names)))
