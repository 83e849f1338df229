"""Blending of transforms at every vertex of every frame: linear, dual quaternions, about given centres.

Single precision; the loops over a vertex's influences have no fixed length.
"""

import numpy as np

from muybridge.geometry.numerics._numba import compiled


@compiled
def linear_blend(maps, shape, starts, joints, weights, out):  # type: ignore[no-untyped-def]
    """Fill out (T, V, 3) with the weighted sums of maps (T, J, 3, 4) of shape (V, 3).

    Source: Magnenat-Thalmann, Laperriere, Thalmann, Joint-dependent local deformations, 1988.
    """
    for t in range(len(maps)):
        for v in range(len(shape)):
            x, y, z = shape[v, 0], shape[v, 1], shape[v, 2]
            a, b, c = np.float32(0), np.float32(0), np.float32(0)
            for n in range(starts[v], starts[v + 1]):
                m, w = maps[t, joints[n]], weights[n]
                a += w * (m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3])
                b += w * (m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3])
                c += w * (m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3])
            out[t, v, 0], out[t, v, 1], out[t, v, 2] = a, b, c


@compiled
def _blended_quat(quat, joints, weights, first, last):  # type: ignore[no-untyped-def]
    """The normalised weighted sum of quaternions, each taken on the side of the heaviest one (antipodes)."""
    p = quat[joints[first]]
    w, x, y, z = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    for n in range(first, last):
        q, share = quat[joints[n]], weights[n]
        if p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3] < 0:
            share = -share
        w += share * q[0]
        x += share * q[1]
        y += share * q[2]
        z += share * q[3]
    size = np.float32(1) / np.sqrt(w * w + x * x + y * y + z * z + np.float32(1e-30))
    return w * size, x * size, y * size, z * size


@compiled
def _turned(w, x, y, z, a, b, c):  # type: ignore[no-untyped-def]
    """(a, b, c) turned by the unit quaternion (w, x, y, z)."""
    two = np.float32(2)
    u, v, s = two * (y * c - z * b), two * (z * a - x * c), two * (x * b - y * a)
    return a + w * u + y * s - z * v, b + w * v + z * u - x * s, c + w * s + x * v - y * u


@compiled
def dual_quaternion_blend(duals, shape, starts, joints, weights, out):  # type: ignore[no-untyped-def]
    """Fill out (T, V, 3) with shape (V, 3) moved by blended unit dual quaternions; duals (T, J, 8), real part first.

    Source: Kavan, Collins, Zara and O'Sullivan, Skinning with dual quaternions, 2007.
    """
    two = np.float32(2)
    for t in range(len(duals)):
        for v in range(len(shape)):
            first, last = starts[v], starts[v + 1]
            p = duals[t, joints[first]]
            w, x, y, z = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
            e, f, g, h = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
            for n in range(first, last):
                q, share = duals[t, joints[n]], weights[n]
                if p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3] < 0:
                    share = -share
                w += share * q[0]
                x += share * q[1]
                y += share * q[2]
                z += share * q[3]
                e += share * q[4]
                f += share * q[5]
                g += share * q[6]
                h += share * q[7]
            size = np.float32(1) / np.sqrt(w * w + x * x + y * y + z * z + np.float32(1e-30))
            w, x, y, z, e, f, g, h = (
                w * size, x * size, y * size, z * size, e * size, f * size, g * size, h * size
            )  # fmt: skip
            a, b, c = _turned(w, x, y, z, shape[v, 0], shape[v, 1], shape[v, 2])
            out[t, v, 0] = a + two * (w * f - e * x + y * h - z * g)
            out[t, v, 1] = b + two * (w * g - e * y + z * f - x * h)
            out[t, v, 2] = c + two * (w * h - e * z + x * g - y * f)


@compiled
def centred_blend(maps, quat, shape, centres, group, starts, joints, weights, out):  # type: ignore[no-untyped-def]
    """Fill out (T, V, 3) with shape (V, 3) turned by blended quaternions about centres that move linearly.

    Args:
        maps: (T, J, 3, 4) rigid.
        quat: (T, J, 4) their rotations.
        shape: (V, 3).
        centres: (1 or T, G, 3), in the space of shape.
        group: (V,) the centre of each vertex.
        starts, joints, weights: `Influences`.
        out: (T, V, 3).
    """
    for t in range(len(maps)):
        table = centres[min(t, len(centres) - 1)]
        for v in range(len(shape)):
            first, last = starts[v], starts[v + 1]
            o = table[group[v]]
            if last - first == 1:  # a rigid map has one result about any centre
                o = shape[v]
            a, b, c = np.float32(0), np.float32(0), np.float32(0)
            for n in range(first, last):
                m, share = maps[t, joints[n]], weights[n]
                a += share * (m[0, 0] * o[0] + m[0, 1] * o[1] + m[0, 2] * o[2] + m[0, 3])
                b += share * (m[1, 0] * o[0] + m[1, 1] * o[1] + m[1, 2] * o[2] + m[1, 3])
                c += share * (m[2, 0] * o[0] + m[2, 1] * o[1] + m[2, 2] * o[2] + m[2, 3])
            if last - first > 1:
                w, x, y, z = _blended_quat(quat[t], joints, weights, first, last)
                d, e, f = _turned(w, x, y, z, shape[v, 0] - o[0], shape[v, 1] - o[1], shape[v, 2] - o[2])
                a, b, c = a + d, b + e, c + f
            out[t, v, 0], out[t, v, 1], out[t, v, 2] = a, b, c
