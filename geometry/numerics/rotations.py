"""Rotations on arrays: exponential map, swing and twist, quaternions that are continuous over time.

All functions accept any leading shape. Quaternions are `wxyz`, unit length. Matrices act on column vectors.
"""

import numpy as np
import scipy

from muybridge.arrays import FloatArray


def _cross_matrix(vectors: FloatArray) -> FloatArray:
    """(..., 3) to (..., 3, 3) matrix of `v x`."""
    out = np.zeros((*vectors.shape[:-1], 3, 3))
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -z, y, -x
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = z, -y, x
    return out


def exp_so3(rotvec: FloatArray) -> FloatArray:
    """(..., 3) rotation vectors to (..., 3, 3) matrices (Rodrigues)."""
    angle = np.sqrt(np.sum(rotvec * rotvec, axis=-1))[..., None, None]
    out = np.sinc(angle / np.pi) * _cross_matrix(rotvec)
    out += 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (rotvec[..., :, None] * rotvec[..., None, :])
    out += np.cos(angle) * np.eye(3)
    return np.asarray(out)


def left_jacobian_so3(rotvec: FloatArray) -> FloatArray:
    """(..., 3) to (..., 3, 3): `exp(v + dv) = exp(J dv) exp(v)` to first order.

    Source: Sola, Deray, Atchuthan, "A micro Lie theory for state estimation in robotics", equation 145.
    """
    angle_sq = np.sum(rotvec * rotvec, axis=-1)[..., None, None]
    angle = np.sqrt(angle_sq)
    cross = _cross_matrix(rotvec)
    b = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    small = angle_sq < 1e-4
    safe = np.where(small, 1.0, angle_sq)
    c = np.where(small, 1 / 6 - angle_sq / 120, (1 - np.sinc(angle / np.pi)) / safe)
    return np.asarray(np.eye(3) + b * cross + c * (cross @ cross))


def log_so3(matrices: FloatArray) -> FloatArray:
    """(..., 3, 3) to (..., 3) rotation vectors of at most pi; the matrices need only be nearly orthogonal."""
    flat = scipy.spatial.transform.Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_rotvec()
    return np.asarray(flat.reshape(*matrices.shape[:-2], 3))


def quat_from_matrix(matrices: FloatArray) -> FloatArray:
    """(..., 3, 3) matrices to (..., 4) quaternions wxyz."""
    xyzw = scipy.spatial.transform.Rotation.from_matrix(matrices.reshape(-1, 3, 3)).as_quat()
    return np.asarray(np.roll(xyzw, 1, axis=-1).reshape(*matrices.shape[:-2], 4))


def quat_from_rotation(matrices: FloatArray) -> FloatArray:
    """(..., 3, 3) to (..., 4) quaternions wxyz, as `quat_from_matrix` but several times faster.

    Nothing is orthogonalised first: the matrices are rotations to rounding already. Each quaternion comes from its
    largest component, after S. W. Shepperd, "Quaternion from rotation matrix", 1978.
    """
    m = matrices
    diagonal = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    products = np.empty((*m.shape[:-2], 4, 4))  # of each component of the quaternion with each other, times four
    products[..., 0, 0] = 1 + diagonal[0] + diagonal[1] + diagonal[2]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        products[..., i + 1, i + 1] = 1 + diagonal[i] - diagonal[j] - diagonal[k]
        products[..., 0, i + 1] = products[..., i + 1, 0] = m[..., k, j] - m[..., j, k]
        products[..., i + 1, j + 1] = products[..., j + 1, i + 1] = m[..., j, i] + m[..., i, j]
    largest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    out = np.take_along_axis(products, largest[..., None, None], axis=-2)[..., 0, :]
    return np.asarray(out / np.linalg.norm(out, axis=-1, keepdims=True))


def matrix_from_quat(quat_wxyz: FloatArray) -> FloatArray:
    """(..., 4) quaternions wxyz, which are normalised, to (..., 3, 3) matrices."""
    q = quat_wxyz / np.linalg.norm(quat_wxyz, axis=-1, keepdims=True)
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    out = np.empty((*q.shape[:-1], 3, 3))
    out[..., 0, 0] = 1 - 2 * (y * y + z * z)
    out[..., 0, 1] = 2 * (x * y - w * z)
    out[..., 0, 2] = 2 * (x * z + w * y)
    out[..., 1, 0] = 2 * (x * y + w * z)
    out[..., 1, 1] = 1 - 2 * (x * x + z * z)
    out[..., 1, 2] = 2 * (y * z - w * x)
    out[..., 2, 0] = 2 * (x * z - w * y)
    out[..., 2, 1] = 2 * (y * z + w * x)
    out[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return out


def continuous_quat(quat_wxyz: FloatArray) -> FloatArray:
    """(T, ..., 4) the same rotations, with signs chosen such that consecutive quaternions are in the same half-space.

    The first frame has a non-negative w.
    """
    if not len(quat_wxyz):
        return quat_wxyz.copy()
    dots = np.sum(quat_wxyz[1:] * quat_wxyz[:-1], axis=-1)
    first = np.where(quat_wxyz[:1, ..., 0] < 0, -1.0, 1.0)
    signs = np.cumprod(np.concatenate([first, np.where(dots < 0, -1.0, 1.0)]), axis=0)
    return np.asarray(quat_wxyz * signs[..., None])


def multiply_quat(first: FloatArray, second: FloatArray) -> FloatArray:
    """(..., 4) wxyz: the product of quaternions, the rotation `second` followed by `first`; shapes broadcast."""
    w, x, y, z = np.moveaxis(first, -1, 0)
    a, b, c, d = np.moveaxis(second, -1, 0)
    return np.stack([w * a - x * b - y * c - z * d, w * b + x * a + y * d - z * c,
                     w * c - x * d + y * a + z * b, w * d + x * c - y * b + z * a], axis=-1)  # fmt: skip


def conjugate_quat(quat_wxyz: FloatArray) -> FloatArray:
    """(..., 4) wxyz: the inverse rotations of unit quaternions."""
    return np.asarray(quat_wxyz * np.array([1.0, -1.0, -1.0, -1.0]))


def quat_from_rotvec(rotvec: FloatArray) -> FloatArray:
    """(..., 3) rotation vectors to (..., 4) quaternions wxyz."""
    angle = np.linalg.norm(rotvec, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * rotvec], axis=-1)


def rotvec_from_quat(quat_wxyz: FloatArray) -> FloatArray:
    """(..., 4) quaternions wxyz to (..., 3) rotation vectors of at most pi; exact near the identity."""
    quat = np.where(quat_wxyz[..., :1] < 0, -quat_wxyz, quat_wxyz)
    sine = np.linalg.norm(quat[..., 1:], axis=-1, keepdims=True)
    scale = np.where(sine > 1e-150, 2 * np.arctan2(sine, quat[..., :1]) / np.maximum(sine, 1e-150), 2.0)
    return np.asarray(scale * quat[..., 1:])


def slerp(first: FloatArray, second: FloatArray, share: FloatArray) -> FloatArray:
    """(..., 4) quaternions wxyz on the shortest way from `first` (share 0) to `second` (share 1); shapes broadcast.

    Args:
        first: (..., 4).
        second: (..., 4).
        share: (...) without the quaternions' axis.
    """
    way = rotvec_from_quat(multiply_quat(conjugate_quat(first), second))
    return multiply_quat(first, quat_from_rotvec(way * np.asarray(share)[..., None]))


def matrix_from_swing_twist(coordinates: FloatArray, twist_axis: int) -> FloatArray:
    """(..., 3) angles about x, y, z to (..., 3, 3): the twist about `twist_axis` first, then the swing.

    The two other components are a rotation vector perpendicular to the twist axis (the swing); for a bone along the
    twist axis, the swing alone determines its direction, and the twist its roll.
    """
    twist = np.zeros_like(coordinates)
    twist[..., twist_axis] = coordinates[..., twist_axis]
    return np.asarray(exp_so3(coordinates - twist) @ exp_so3(twist))


def swing_twist_from_matrix(matrices: FloatArray, twist_axis: int) -> FloatArray:
    """Inverse of `matrix_from_swing_twist`: (..., 3, 3) to (..., 3), each angle in -pi..pi.

    The twist of a swing of exactly pi is undefined; the result still composes to the matrix.
    """
    quat = quat_from_matrix(matrices)
    twist = np.zeros_like(quat)
    twist[..., 0], twist[..., 1 + twist_axis] = quat[..., 0], quat[..., 1 + twist_axis]
    norm = np.linalg.norm(twist, axis=-1, keepdims=True)
    twist = np.where(norm > 1e-9, twist / np.maximum(norm, 1e-9), np.array([1.0, 0, 0, 0]))
    twist = np.where(twist[..., :1] < 0, -twist, twist)
    swing = log_so3(matrices @ np.swapaxes(matrix_from_quat(twist), -1, -2))
    swing[..., twist_axis] = 2 * np.arctan2(twist[..., 1 + twist_axis], twist[..., 0])
    return swing


def kabsch(source: FloatArray, target: FloatArray, weights: FloatArray) -> FloatArray:
    """Rotations that best map `source` to `target` about the origin, without translation (Kabsch 1976).

    Args:
        source: (..., N, 3).
        target: (..., N, 3).
        weights: (..., N), zero for points to be ignored (their coordinates must still be finite).

    Returns:
        (..., 3, 3), always proper. With fewer than two independent directions, one of the best rotations.
    """
    covariance = np.einsum("...ni,...n,...nj->...ij", target, weights, source)
    u, _, vt = np.linalg.svd(covariance)
    sign = np.sign(np.linalg.det(u @ vt))
    u[..., :, 2] *= np.where(sign < 0, -1.0, 1.0)[..., None]
    return np.asarray(u @ vt)
