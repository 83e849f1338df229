"""Transitions one by one: how the entered window is laid over the left one, and how hard the blend accelerates."""

import numpy as np

from muybridge.arrays import Float32Array, FloatArray, IntArray
from muybridge.geometry.numerics._numba import compiled


@compiled
def align_transitions(
    cloud: Float32Array, weights: FloatArray, leave: IntArray, enter: IntArray, window: int
) -> tuple[FloatArray, FloatArray]:
    """The best turn and shift of each transition: `planar_alignment` of its windows.

    Args:
        cloud: (F, N, 3) metres.
        weights: (N,) their sum one.
        leave: (E,) first frame of the window that is left.
        enter: (E,) and of the one that is laid over it.
        window: frames.

    Returns:
        (E,) radians, and (E, 2) metres.
    """
    yaw, shift = np.zeros(len(leave)), np.zeros((len(leave), 2))
    points = cloud.shape[1]
    for e in range(len(leave)):
        ax, ay, bx, by = 0.0, 0.0, 0.0, 0.0
        for k in range(window):
            a, b = cloud[leave[e] + k], cloud[enter[e] + k]
            for n in range(points):
                w = weights[n] / window
                ax += w * a[n, 0]
                ay += w * a[n, 1]
                bx += w * b[n, 0]
                by += w * b[n, 1]
        along, across = 0.0, 0.0
        for k in range(window):
            a, b = cloud[leave[e] + k], cloud[enter[e] + k]
            for n in range(points):
                px, py, qx, qy = a[n, 0] - ax, a[n, 1] - ay, b[n, 0] - bx, b[n, 1] - by
                along += weights[n] * (px * qx + py * qy)
                across += weights[n] * (qx * py - qy * px)
        turn = np.arctan2(across, along)
        c, s = np.cos(turn), np.sin(turn)
        yaw[e] = turn
        shift[e, 0] = ax - (c * bx - s * by)
        shift[e, 1] = ay - (s * bx + c * by)
    return yaw, shift


@compiled
def transition_peaks(
    cloud: Float32Array, bends: Float32Array, leave: IntArray, enter: IntArray, yaw: FloatArray, shift: FloatArray,
    share: FloatArray, limits: FloatArray,
) -> FloatArray:  # fmt: skip
    """(E,) the hardest acceleration of a point in the blend of a transition, as a share of what it may have: its limit,
    or what it has in the two windows themselves.

    Points are blended in the world, which is within a few per cent of what their joints do.

    Args:
        cloud: (F, N, 3) metres.
        bends: (F, N) metres per frame squared, of the points in the clips.
        leave: (E,) first frame of the window that is left.
        enter: (E,) and of the one that is entered.
        yaw: (E,) radians by which the entered clip is turned.
        shift: (E, 2) metres by which it is then shifted.
        share: (window,) of the left motion.
        limits: (N,) metres per frame squared.
    """
    window, frames, points = len(share), cloud.shape[0], cloud.shape[1]
    out = np.zeros(len(leave))
    three, hardest, allowed = np.zeros((3, points, 3)), np.zeros(points), np.zeros(points)
    for e in range(len(leave)):
        c, s = np.cos(yaw[e]), np.sin(yaw[e])
        filled = 0
        for n in range(points):
            hardest[n], allowed[n] = 0.0, limits[n]
        for k in range(-2, window + 2):
            i, j = leave[e] + k, enter[e] + k
            old = 1.0 if k < 0 else (0.0 if k >= window else share[k])
            if (old > 0.0 and i < 0) or (old < 1.0 and j >= frames):
                continue
            row = three[filled % 3]
            for n in range(points):
                x, y, z = 0.0, 0.0, 0.0
                if old < 1.0:
                    u, v = cloud[j, n, 0], cloud[j, n, 1]
                    x, y, z = c * u - s * v + shift[e, 0], s * u + c * v + shift[e, 1], cloud[j, n, 2]
                if old > 0.0:
                    x = old * cloud[i, n, 0] + (1.0 - old) * x
                    y = old * cloud[i, n, 1] + (1.0 - old) * y
                    z = old * cloud[i, n, 2] + (1.0 - old) * z
                row[n, 0], row[n, 1], row[n, 2] = x, y, z
            filled += 1
            if filled < 3:
                continue
            now, last, first = three[(filled - 1) % 3], three[(filled - 2) % 3], three[(filled - 3) % 3]
            for n in range(points):
                size = 0.0
                for q in range(3):
                    bend = now[n, q] - 2.0 * last[n, q] + first[n, q]
                    size += bend * bend
                hardest[n] = max(hardest[n], np.sqrt(size))
        for k in range(window):
            for n in range(points):
                allowed[n] = max(allowed[n], bends[leave[e] + k, n], bends[enter[e] + k, n])
        for n in range(points):
            out[e] = max(out[e], hardest[n] / max(allowed[n], 1e-12))
    return out
