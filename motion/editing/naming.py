"""Names of another program for the joints of a motion."""

from dataclasses import replace

from muybridge.errors import MuybridgeError
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.profiles import PROFILES, detect_profile, roles_of
from muybridge.geometry.skeleton.profiles import rename as rename_skeleton


def new_names(motion: Motion, profile: str) -> dict[str, str]:
    """Old name -> new name, of the joints that `rename_joints` renames.

    Raises:
        MuybridgeError: as `rename_joints`.
    """
    if profile not in PROFILES:
        raise MuybridgeError(f"no set of names {profile!r}: choose one of {', '.join(PROFILES)}")
    names = motion.skeleton.names
    roles = roles_of(names)
    if not roles:
        raise MuybridgeError("the roles of the joints are not known by their names, so that none can be renamed; "
                             f"the joints are {', '.join(names[:12])}{' ...' if len(names) > 12 else ''}")  # fmt: skip
    out = {names[j]: PROFILES[profile][role] for role, j in roles.items() if role in PROFILES[profile]}
    kept = set(names) - set(out)
    if taken := sorted(kept & set(out.values())):
        raise MuybridgeError(f"{taken[0]!r} is the name of another joint already, which {profile} has no name for")
    return out


def rename_joints(motion: Motion, profile: str) -> Motion:
    """The motion with the joint names of another program; joints that have no name there keep theirs.

    Args:
        motion: with joints that are known by their names.
        profile: a key of `muybridge.geometry.skeleton.PROFILES`.

    Raises:
        MuybridgeError: an unknown profile, joints of unknown roles, or a new name that another joint has.
    """
    new_names(motion, profile)
    skeleton = motion.skeleton
    return replace(motion, skeleton=rename_skeleton(skeleton, profile, detect_profile(skeleton.names)))
