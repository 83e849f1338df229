"""The skeletons that can be put into a mesh, in one table: joints by role, and which hangs on which."""

from dataclasses import dataclass

from muybridge.geometry.skeleton.profiles import FINGERS, PROFILES

RIGS = ("muybridge", "mixamo", "ue5", "vrm", "humanik")  # names of joints that can be chosen

_SIDED = (("clavicle", "chest"), ("upper_arm", "clavicle"), ("forearm", "upper_arm"), ("hand", "forearm"),
          ("thigh", "hips"), ("shin", "thigh"), ("foot", "shin"), ("toe", "foot"))  # fmt: skip
_TRUNK = (("hips", ""), ("spine", "hips"), ("chest", "spine"), ("upper_chest", "chest"), ("neck", "upper_chest"),
          ("head", "neck"))  # fmt: skip
_LEG_OF_ANIMAL = (("front_scapula", "chest"), ("front_upper", "front_scapula"), ("front_lower", "front_upper"),
                  ("front_foot", "front_lower"), ("back_thigh", "hips"), ("back_shin", "back_thigh"),
                  ("back_ankle", "back_shin"), ("back_foot", "back_ankle"))  # fmt: skip


@dataclass(frozen=True)
class Template:
    """A skeleton to embed.

    Attributes:
        name: of the template.
        parents: role -> role of the parent, "" for the root; parents come first.
        limbs: how many there must be: 2 legs and 2 arms, or 4 legs.
        says: one line for help texts.
    """

    name: str
    parents: dict[str, str]
    limbs: str
    says: str

    @property
    def roles(self) -> tuple[str, ...]:
        """All joints."""
        return tuple(self.parents)


def _both(pairs: tuple[tuple[str, str], ...], trunk: dict[str, str], chest: str) -> dict[str, str]:
    out = {}
    for side in ("left", "right"):
        for part, parent in pairs:
            above = chest if parent == "chest" else parent
            out[f"{side}_{part}"] = above if above in trunk else f"{side}_{above}"
    return out


def _human(fingers: bool) -> dict[str, str]:
    trunk = dict(_TRUNK)
    out = trunk | _both(_SIDED, trunk, "upper_chest")
    if fingers:
        for side in ("left", "right"):
            for finger in FINGERS:
                for k in (1, 2, 3):
                    out[f"{side}_{finger}_{k}"] = f"{side}_{finger}_{k - 1}" if k > 1 else f"{side}_hand"
    return out


def _biped() -> dict[str, str]:
    trunk = {"hips": "", "spine": "hips", "chest": "spine", "head": "chest"}
    pairs = tuple(("upper_arm", "chest") if part == "upper_arm" else (part, above)
                  for part, above in _SIDED if part not in ("clavicle", "toe"))  # fmt: skip
    return trunk | _both(pairs, trunk, "chest")


def _quadruped() -> dict[str, str]:
    trunk = {"hips": "", "spine": "hips", "chest": "spine", "neck": "chest", "head": "neck", "tail_1": "hips",
             "tail_2": "tail_1", "tail_3": "tail_2"}  # fmt: skip
    return trunk | _both(_LEG_OF_ANIMAL, trunk, "chest")


TEMPLATES: dict[str, Template] = {
    t.name: t
    for t in (
        Template("human", _human(False), "2 legs and 2 arms", "a person or a humanoid, without fingers"),
        Template("human-with-fingers", _human(True), "2 legs and 2 arms", "the same with five fingers a hand"),
        Template("biped", _biped(), "2 legs and 2 arms", "few joints, for cartoons and toys"),
        Template("quadruped", _quadruped(), "4 legs", "an animal on four legs"),
    )
}


def joint_names(template: Template, rig: str) -> tuple[str, ...]:
    """The joints of a template by a program's names; roles that it has no name for keep theirs.

    Raises:
        ValueError: an unknown rig.
    """
    if rig not in RIGS:
        raise ValueError(f"unknown rig {rig!r}: choose one of {', '.join(RIGS)}")
    return tuple(PROFILES[rig].get(role, role) for role in template.roles)
