"""A map of roles as text, for a user to correct."""

from muybridge.geometry.roles.role_map import CORE_ROLES, RoleMap
from muybridge.geometry.skeleton.profiles import ROLES
from muybridge.geometry.skeleton.skeleton import Skeleton

_HOW = {
    "map": "the map that was given",
    "vrm": "the file's own table",
    "geometry": "the shape of the skeleton, since its names are of no known program",
    "none": "nothing: no body with two legs, a trunk and two arms was recognised",
}


def suggest_role_map(skeleton: Skeleton, found: RoleMap) -> str:
    """The TOML text of a map with every role that was found, and the joints that are left.

    Args:
        skeleton: of which the roles are.
        found: by `find_roles`.
    """
    how = _HOW.get(found.how) or f"the names, which are those of {found.how.removeprefix('names:')}"
    if found.how == "names:words":
        how = "the names, by their words"
    lines = [
        '# Which joint is which part of the body: role = "joint". Correct what is wrong.',
        f"# Found by {how}.",
        *(f"# Note: {note}." for note in found.notes),
    ]
    for role in ROLES:
        if role in found.roles:
            lines.append(f'{role} = "{_escaped(skeleton.names[found.roles[role]])}"')
        elif role in CORE_ROLES:
            lines.append(f'# {role} = ""    # not found')
    left = [name for j, name in enumerate(skeleton.names) if j not in found.roles.values()]
    if left:
        lines.append(f"# Joints without a role: {', '.join(left)}")
    return "\n".join(lines) + "\n"


def _escaped(name: str) -> str:
    return name.replace("\\", "\\\\").replace('"', '\\"')
