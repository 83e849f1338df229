"""Landmark sets: names, bones and left-right pairs."""

from dataclasses import dataclass


@dataclass(frozen=True)
class LandmarkSet:
    """An ordered set of named body points.

    Attributes:
        name: identifier of the set, e.g. ``"body23"``.
        names: the landmarks in the order of every array's `J` axis.
        edges: pairs of names that are connected by bones.
    """

    name: str
    names: tuple[str, ...]
    edges: tuple[tuple[str, str], ...]

    def __len__(self) -> int:
        return len(self.names)

    def index(self, name: str) -> int:
        """Index of `name`; ValueError if the set has no such landmark."""
        return self.names.index(name)

    @property
    def mirror(self) -> tuple[int, ...]:
        """For each landmark the index of its counterpart on the other side (itself where there is none)."""

        def twin(name: str) -> str:
            if name.startswith("left_"):
                return "right_" + name[5:]
            return "left_" + name[6:] if name.startswith("right_") else name

        return tuple(self.names.index(twin(n)) for n in self.names)

    @property
    def edge_indices(self) -> tuple[tuple[int, int], ...]:
        """`edges` as pairs of indices."""
        return tuple((self.index(a), self.index(b)) for a, b in self.edges)


def both(a: str, b: str) -> tuple[tuple[str, str], tuple[str, str]]:
    return (f"left_{a}", f"left_{b}"), (f"right_{a}", f"right_{b}")


# The order of anny's COCO regressor: COCO-17, then six points of the feet.
BODY23 = LandmarkSet(
    name="body23",
    names=(
        "nose", "left_eye", "right_eye", "left_ear", "right_ear",
        "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
        "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
        "left_big_toe", "right_big_toe", "left_small_toe", "right_small_toe", "left_heel", "right_heel",
    ),
    edges=(
        ("nose", "left_eye"), ("nose", "right_eye"), *both("eye", "ear"),
        ("left_shoulder", "right_shoulder"), ("left_hip", "right_hip"),
        *both("shoulder", "elbow"), *both("elbow", "wrist"), *both("shoulder", "hip"),
        *both("hip", "knee"), *both("knee", "ankle"), *both("ankle", "heel"),
        *both("ankle", "big_toe"), *both("big_toe", "small_toe"), *both("heel", "big_toe"),
    ),
)  # fmt: skip


def side_of(name: str) -> str:
    """``"left"``, ``"right"`` or ``"middle"``, from the name of a landmark or joint."""
    lowered = name.lower()
    for side in ("left", "right"):
        if lowered.startswith(side) or lowered.endswith(side):
            return side
    return "middle"
