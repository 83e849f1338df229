"""Names of another program for the joints of a motion."""

from collections.abc import Mapping
from dataclasses import replace

from muybridge.errors import MuybridgeError
from muybridge.geometry.roles import find_motion_roles
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.profiles import PROFILES


def new_names(motion: Motion, profile: str, roles: Mapping[str, int] | None = None) -> dict[str, str]:
    """Old name -> new name, of the joints that `rename_joints` renames.

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
    out = {names[j]: PROFILES[profile][role] for role, j in roles.items() if role in PROFILES[profile]}
    kept = set(names) - set(out)
    if taken := sorted(kept & set(out.values())):
        raise MuybridgeError(f"{taken[0]!r} is the name of another joint already, which {profile} has no name for")
    return out


def rename_joints(motion: Motion, profile: str, roles: Mapping[str, int] | None = None) -> Motion:
    """The motion with the joint names of another program; joints that have no name there keep theirs.

    Args:
        motion: of a human body.
        profile: a key of `muybridge.geometry.skeleton.PROFILES`.
        roles: role -> joint; None finds them.

    Raises:
        MuybridgeError: an unknown profile, joints of unknown roles, or a new name that another joint has.
    """
    new = new_names(motion, profile, roles)
    skeleton = motion.skeleton
    return replace(motion, skeleton=replace(skeleton, names=tuple(new.get(name, name) for name in skeleton.names)))
