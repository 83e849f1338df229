from .find import find_motion_roles as find_motion_roles
from .find import find_roles as find_roles
from .role_map import CORE_ROLES as CORE_ROLES
from .role_map import RoleMap as RoleMap
from .role_map import load_role_map as load_role_map
from .suggest import suggest_role_map as suggest_role_map

__all__ = [
    "CORE_ROLES",
    "RoleMap",
    "find_motion_roles",
    "find_roles",
    "load_role_map",
    "suggest_role_map",
]
