"""`.style` files: what was learned from takes, as NumPy's `.npz` of plain arrays.

The array `muybridge_style` is a text in JSON, in UTF-8: version, names of the joints, their parents and roles, names of
the takes and the number of examples. The others are those of `Style` and of its prior; instead of precisions there are
`factors` (K, N, N), lower triangular, of which each times its transpose is a precision. Means and factors are in single
precision.
"""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.described_npz import DescribedFile
from muybridge.geometry.ik.pose_prior import PosePrior
from muybridge.motion.style.model import Style

SUFFIX = ".style"
# The mark says that muybridge wrote the file, in its first bytes.
_FILE = DescribedFile("muybridge_style", "a style", "learn_style", packed=True)


def save_style(path: Path, style: Style) -> None:
    """Write a style.

    Raises:
        OutputError: the file cannot be written.
    """
    about = {"joints": style.joints, "parents": style.parents, "roles": dict(style.roles),
             "takes": style.takes, "examples": style.examples}  # fmt: skip
    arrays: dict[str, NDArray[Any]] = {
        "offsets": style.offsets,
        "mean_wxyz": style.mean_wxyz,
        "hinge_joints": style.hinge_joints.astype(np.int32),
        "hinge_axes": style.hinge_axes,
        "lower": style.lower,
        "upper": style.upper,
        "means": style.prior.means.astype(np.float32),
        "factors": np.linalg.cholesky(style.prior.precisions).astype(np.float32),
        "log_scale": style.prior.log_scale,
    }
    _FILE.write(path, about, arrays)


def load_style(path: Path) -> Style:
    """Read a style.

    Raises:
        FormatError: it is none, of another version, or damaged.
    """
    return _FILE.read(path, _style)


def _style(about: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> Style:
    def real(name: str) -> NDArray[np.float64]:
        values = arrays[name].astype(np.float64)
        if not np.isfinite(values).all():
            raise ValueError(f"{name} holds numbers that are not finite")
        return values

    joints = tuple(str(n) for n in about["joints"])
    hinges = arrays["hinge_joints"].astype(np.intp)
    names, counts = [], dict.fromkeys(hinges.tolist(), 0)
    for j in hinges.tolist():
        names.append(f"{joints[j]}.{counts[j]}")
        counts[j] += 1
    factors = np.tril(real("factors"))
    prior = PosePrior(tuple(names), real("means"), factors @ np.swapaxes(factors, -1, -2), real("log_scale"))
    style = Style(
        joints, tuple(int(p) for p in about["parents"]), real("offsets"),
        {str(role): int(j) for role, j in about["roles"].items()}, real("mean_wxyz"), hinges, real("hinge_axes"),
        real("lower"), real("upper"), prior, tuple(str(t) for t in about["takes"]), int(about["examples"]),
    )  # fmt: skip
    _check(style)
    return style


def _check(style: Style) -> None:
    """ValueError where the parts of a style do not belong to each other."""
    count, n, k = len(style.joints), len(style.hinge_joints), len(style.prior.means)
    if not n or not k or len(set(style.joints)) != count or len(style.parents) != count:
        raise ValueError("joints, parents or angles are missing")
    if style.parents[0] != -1 or any(not 0 <= p < j for j, p in enumerate(style.parents[1:], start=1)):
        raise ValueError("a joint's parent does not come before it")
    shapes = {
        "offsets": (style.offsets, (count, 3)), "mean_wxyz": (style.mean_wxyz, (count, 4)),
        "hinge_axes": (style.hinge_axes, (n, 3)), "lower": (style.lower, (n,)), "upper": (style.upper, (n,)),
        "means": (style.prior.means, (k, n)), "factors": (style.prior.precisions, (k, n, n)),
        "log_scale": (style.prior.log_scale, (k,)),
    }  # fmt: skip
    for name, (array, shape) in shapes.items():
        if array.shape != shape:
            raise ValueError(f"{name} has the shape {array.shape}, and {shape} is needed")
    if (np.diff(style.hinge_joints) < 0).any() or style.hinge_joints[0] < 1 or style.hinge_joints[-1] >= count:
        raise ValueError("an angle is of a joint that does not exist, or out of order")
    if any(not 0 <= j < count for j in style.roles.values()):
        raise ValueError("a role is of a joint that does not exist")
    for name, array in (("mean_wxyz", style.mean_wxyz), ("hinge_axes", style.hinge_axes)):
        if np.abs(np.linalg.norm(array, axis=1) - 1).max() > 1e-3:
            raise ValueError(f"{name} holds no unit vectors")
    if not (style.lower <= style.upper).all():
        raise ValueError("a lower limit is above its upper limit")
    if np.diagonal(np.linalg.cholesky(style.prior.precisions), axis1=1, axis2=2).min() <= 0:
        raise ValueError("factors belong to no precisions")
