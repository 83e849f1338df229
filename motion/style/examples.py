"""Example poses of takes, far enough apart that a long take of one pose counts no more than a short one.

Source: K. Grochow, S. L. Martin, A. Hertzmann, Z. Popovic, "Style-based inverse kinematics", 2004, section 4, which
learns from poses chosen to be unlike each other. Here they are chosen farthest first (T. Gonzalez, "Clustering to
minimize the maximum intercluster distance", 1985).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from muybridge.arrays import FloatArray, IndexArray
from muybridge.errors import MuybridgeError
from muybridge.geometry.numerics.rotations import matrix_from_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.editing.channels import check_editable
from muybridge.motion.editing.mirroring import mirror

APART_M = 0.01  # root mean square over the joints, by which two examples differ at least
MOST = 1000  # examples that a style is learned from
PARTS = 5  # of a take
_MOST_FRAMES = 20_000  # of a take that are compared; of longer ones every second, third...
_SLIDE_M = 0.02  # that a joint may slide and still be held


@dataclass(frozen=True, eq=False)
class Examples:
    """`E` poses of one skeleton.

    Attributes:
        skeleton: whose, with rigid bones.
        quat_wxyz: (E, J, 4) rotation of each joint relative to its parent; the root's do not matter.
        takes: names of the takes that they are from.
        part: (E,) which fifth of which take: five times the take's number, plus 0 to 4. Parts are left out together to
            judge how well a style goes beyond its examples.
    """

    skeleton: Skeleton
    quat_wxyz: FloatArray
    takes: tuple[str, ...]
    part: IndexArray

    def __len__(self) -> int:
        return len(self.quat_wxyz)

    def merged(self, other: "Examples", apart: float = APART_M, most: int = MOST) -> "Examples":
        """Both together, thinned out again; of this one's skeleton.

        Raises:
            ValueError: they have other joints.
        """
        if self.skeleton.names != other.skeleton.names:
            raise ValueError("examples of two skeletons cannot be merged")
        takes = tuple(dict.fromkeys((*self.takes, *other.takes)))
        number = np.array([takes.index(name) for name in other.takes])
        part = number[other.part // PARTS] * PARTS + other.part % PARTS
        both = Examples(self.skeleton, np.concatenate([self.quat_wxyz, other.quat_wxyz]), takes,
                        np.concatenate([self.part, part]))  # fmt: skip
        return both.thinned(apart, most)

    def thinned(self, apart: float = APART_M, most: int = MOST) -> "Examples":
        """The examples that are at least `apart` metres from each other, and no more than `most`."""
        kept = np.sort(farthest_first(_shape_of(self.skeleton, self.quat_wxyz), apart, most))
        return replace(self, quat_wxyz=self.quat_wxyz[kept], part=self.part[kept])


def examples_of(
    name: str, motion: Motion, mirrored: bool = False, roles: Mapping[str, int] | None = None, apart: float = APART_M,
    most: int = MOST,
) -> Examples:  # fmt: skip
    """The example poses of a take.

    Args:
        name: of the take, for messages and for the record.
        motion: at least two frames.
        mirrored: whether each pose counts a second time, with left and right exchanged.
        roles: role -> joint, for mirroring; None finds them.
        apart: metres, root mean square over the joints, by which two examples differ at least.
        most: examples that are kept.

    Raises:
        MuybridgeError: the take has a single frame, joints that slide, several roots, or no two sides to be mirrored.
    """
    try:
        check_editable(motion)
        if len(motion) < 2:
            raise MuybridgeError("has one frame; a style is learned from movement, of two frames or more")
        # Decimated before anything else: what follows costs the same for an hour as for a minute.
        short = motion.select(slice(None, None, -(-len(motion) // _MOST_FRAMES)))
        try:
            rigid = short.with_rigid_bones(_SLIDE_M)
        except ValueError as error:
            raise MuybridgeError(f"{error}; a style is of a skeleton with one root and rigid bones") from error
        part = np.arange(len(rigid)) * PARTS // len(rigid)
        found = Examples(rigid.skeleton, rigid.quat_wxyz, (name,), part).thinned(apart, most)
        if mirrored:
            image = Examples(rigid.skeleton, mirror(rigid, roles=roles).quat_wxyz, (name,), part)
            return found.merged(image.thinned(apart, most), apart, most)
    except MuybridgeError as error:
        raise error.about(name) from error
    return found


def farthest_first(points: FloatArray, apart: float, most: int) -> IndexArray:
    """Rows (E,) of points (T, D), each the farthest one from those before it, until none is `apart` from all of them.

    The first is the one nearest to the mean.
    """
    first = int(np.argmin(((points - points.mean(axis=0)) ** 2).sum(axis=1)))
    chosen = [first]
    nearest = ((points - points[first]) ** 2).sum(axis=1)
    while len(chosen) < most:
        at = int(np.argmax(nearest))
        if nearest[at] < apart**2 or nearest[at] == 0:
            break
        chosen.append(at)
        np.minimum(nearest, ((points - points[at]) ** 2).sum(axis=1), out=nearest)
    return np.array(chosen, dtype=np.intp)


def _shape_of(skeleton: Skeleton, quat_wxyz: FloatArray) -> FloatArray:
    """(T, 3 J) joints' places in the root's axes, scaled so that a distance is the root mean square over the joints."""
    turns = matrix_from_quat(quat_wxyz)
    turns[:, 0] = np.eye(3)
    _, places = skeleton.forward(np.zeros((len(turns), 3)), turns)
    return places.reshape(len(turns), -1).astype(np.float32) / np.sqrt(len(skeleton), dtype=np.float32)  # type: ignore[no-any-return]
