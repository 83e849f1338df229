"""Loops of volume-keeping skinning over the hinges of a surface; see `flesh`."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.numerics._numba import compiled

if TYPE_CHECKING:
    from muybridge.arrays import Float32Array, IndexArray, IntArray
    from muybridge.motion.character.skinning.flesh import Packed

_SOFT = 0.05  # of the radius: how near to the plane of contact the surface begins to give way
_PRESSED = 0.02  # of the radius: what contact has moved so far takes no more volume
_BESIDE = 3.0  # radii, as in `flesh`
_MOST = 0.3  # of the radius, that one correction moves a point
_ROUNDS = 3
_SWEEPS = 3
_BENT = 0.1  # radians, from which on a hinge takes part in full


class AtRest(NamedTuple):
    """A shape as its hinges see it.

    Attributes:
        first, second: (H, 3) unit directions from a hinge to its two sides.
        beyond: (N,) metres that each of the hinges' points may be beyond the plane, zero or less.
        soft: (N,) metres above that where it begins to give way.
        volume: (H,) cubic metres inside, the borders closed by fans.
        scale: (H,) cubic metres that a correction by one radius adds.
    """

    first: FloatArray
    second: FloatArray
    beyond: FloatArray
    soft: FloatArray
    volume: FloatArray
    scale: FloatArray


def keep(
    posed: "Float32Array", first: "IndexArray", point_of: "IndexArray", triangles: "IntArray", rotations: FloatArray,
    rest: AtRest, packed: "Packed",
) -> None:  # fmt: skip
    """Correct posed (T, V, 3) in place; rotations (T, J, 3, 3)."""
    _keep(posed, first, point_of, triangles, rotations, *rest, *packed)


def at_rest(points: FloatArray, packed: "Packed") -> AtRest:
    """What the hinges are for points (P, 3)."""
    p = packed
    return AtRest(*_at_rest(points, p.radius, p.ring_of, p.ring, p.along, p.points_of, p.points, p.side, p.spread,
                            p.triangles_of, p.triangles, p.loops_of, p.borders_of, p.borders))  # fmt: skip


@compiled
def _centre(points, ring, along, start, stop):  # type: ignore[no-untyped-def]
    out = np.zeros(3)
    for i in range(start, stop):
        for c in range(3):
            a = points[ring[i, 0], c]
            out[c] += a + along[i] * (points[ring[i, 1], c] - a)
    return out / (stop - start)


@compiled
def _unit(v):  # type: ignore[no-untyped-def]
    return v / (np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) + 1e-30)


@compiled
def _triple(points, i, j, k, o):  # type: ignore[no-untyped-def]
    a, b, c = points[i, 0] - o[0], points[i, 1] - o[1], points[i, 2] - o[2]
    d, e, f = points[j, 0] - o[0], points[j, 1] - o[1], points[j, 2] - o[2]
    return _mixed(a, b, c, d, e, f, points[k, 0] - o[0], points[k, 1] - o[1], points[k, 2] - o[2])


@compiled
def _mixed(a, b, c, d, e, f, x, y, z):  # type: ignore[no-untyped-def]
    return (b * f - c * e) * x + (c * d - a * f) * y + (a * e - b * d) * z


@compiled
def _volume(points, o, triangles, t0, t1, borders_of, borders, l0, l1):  # type: ignore[no-untyped-def]
    """Inside the triangles and the fans over their borders, seen from o, which only spares digits."""
    total = 0.0
    for f in range(t0, t1):
        total += _triple(points, triangles[f, 0], triangles[f, 1], triangles[f, 2], o)
    for n in range(l0, l1):
        x, y, z = 0.0, 0.0, 0.0
        size = borders_of[n + 1] - borders_of[n]
        for e in range(borders_of[n], borders_of[n + 1]):
            p = borders[e, 0]
            x += (points[p, 0] - o[0]) / size
            y += (points[p, 1] - o[1]) / size
            z += (points[p, 2] - o[2]) / size
        for e in range(borders_of[n], borders_of[n + 1]):
            p, q = borders[e, 1], borders[e, 0]
            total += _mixed(points[p, 0] - o[0], points[p, 1] - o[1], points[p, 2] - o[2],
                            points[q, 0] - o[0], points[q, 1] - o[1], points[q, 2] - o[2], x, y, z)  # fmt: skip
    return total / 6


@compiled
def _at_rest(  # type: ignore[no-untyped-def]
    points, radius, ring_of, ring, along, points_of, at, side, spread, triangles_of, triangles, loops_of, borders_of,
    borders,
):  # fmt: skip
    count = len(radius)
    first, second = np.zeros((count, 3)), np.zeros((count, 3))
    volume, scale, share = np.zeros(count), np.zeros(count), np.zeros(len(points))
    beyond, soft = np.zeros(len(at)), np.zeros(len(at))
    for h in range(count):
        c = _centre(points, ring, along, ring_of[h], ring_of[h + 1])
        for i in range(points_of[h], points_of[h + 1]):
            off = points[at[i]] - c
            if off @ off < (_BESIDE * radius[h]) ** 2:
                if side[i] < 0:
                    first[h] += off
                else:
                    second[h] += off
        first[h], second[h] = _unit(first[h]), _unit(second[h])
        n = _unit(second[h] - first[h])
        for i in range(points_of[h], points_of[h + 1]):
            own = side[i] * ((points[at[i]] - c) @ n)
            beyond[i] = min(own, 0.0)
            soft[i] = min(max(own, 0.0), _SOFT * radius[h])
        volume[h] = _volume(points, c, triangles, triangles_of[h], triangles_of[h + 1], borders_of, borders,
                            loops_of[h], loops_of[h + 1])  # fmt: skip
        for i in range(points_of[h], points_of[h + 1]):
            share[at[i]] = spread[i]
        for f in range(triangles_of[h], triangles_of[h + 1]):
            i, j, k = triangles[f]
            normal = np.cross(points[j] - points[i], points[k] - points[i])
            scale[h] += np.sqrt(normal @ normal) / 6 * (share[i] + share[j] + share[k]) * radius[h]
    return first, second, beyond, soft, volume, scale


@compiled
def _step(x):  # type: ignore[no-untyped-def]
    x = min(max(x, 0.0), 1.0)
    return x * x * (3 - 2 * x)


@compiled
def _bend(first, second, one, other):  # type: ignore[no-untyped-def]
    """Of a turn of the second side against the first.

    (3,) the normal of the plane between both sides; (3,) the inside of the bend, its length the sine between the axis
    of the turn and that normal: nothing for a twist; and the part that a hinge takes, from 0 to 1, by the angle.
    """
    n = _unit(other @ second - one @ first)
    turn = other @ one.T
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    sine, cosine = np.sqrt(axis @ axis) / 2, (turn[0, 0] + turn[1, 1] + turn[2, 2] - 1) / 2
    axis = _unit(axis)
    return n, np.array([axis[1] * n[2] - axis[2] * n[1], axis[2] * n[0] - axis[0] * n[2],
                        axis[0] * n[1] - axis[1] * n[0]]), _step(np.arctan2(sine, cosine) / _BENT)  # fmt: skip


@compiled
def _touching(points, c, n, inner, start, stop, radius, at, side, touch, beyond, soft, free):  # type: ignore[no-untyped-def]
    """Move points of a hinge that crossed its plane back; lower free (P,) of those that it moved."""
    size = np.sqrt(inner @ inner)
    for i in range(start, stop):
        if touch[i] == 0:
            continue
        p = at[i]
        x, y, z = points[p, 0] - c[0], points[p, 1] - c[1], points[p, 2] - c[2]
        over = side[i] * (x * n[0] + y * n[1] + z * n[2]) - beyond[i]
        if over >= soft[i]:
            continue
        # Continuous with its slope, and above the plane however far the point is beyond.
        target = soft[i] * soft[i] / (2 * soft[i] - over) if soft[i] > 0 else 0.0
        inwards = x * inner[0] + y * inner[1] + z * inner[2]
        push = (target - over) * touch[i] * size * _step(inwards / (0.5 * radius) + 0.5)
        for a in range(3):
            points[p, a] += side[i] * push * n[a]
        free[p] = min(free[p], max(1 - push / (_PRESSED * radius), 0.0))


@compiled
def _area_vectors(points, triangles, out):  # type: ignore[no-untyped-def]
    out[:] = 0
    for f in range(len(triangles)):
        i, j, k = triangles[f, 0], triangles[f, 1], triangles[f, 2]
        a, b, c = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
        d, e, g = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
        x, y, z = (b * g - c * e) / 6, (c * d - a * g) / 6, (a * e - b * d) / 6
        for p in (i, j, k):
            out[p, 0] += x
            out[p, 1] += y
            out[p, 2] += z


@compiled
def _field(points, c, inner, missing, radius, start, stop, at, spread, free, field):  # type: ignore[no-untyped-def]
    """Fill field (N,): how far a hinge moves its points for one metre of correction."""
    size = np.sqrt(inner @ inner)
    sign = 1.0 if missing > 0 else -1.0
    for i in range(start, stop):
        p = at[i]
        field[i] = 0.0
        if spread[i] > 0:
            share = 1.0
            if size > 1e-9:
                # Volume is missing where the bend presses, and too much where it stretches.
                x, y, z = points[p, 0] - c[0], points[p, 1] - c[1], points[p, 2] - c[2]
                place = sign * (x * inner[0] + y * inner[1] + z * inner[2]) / size
                share = 1 - size + size * _step(0.5 * place / radius + 0.5)
            field[i] = spread[i] * free[p] * share


@compiled
def _amounts(areas, missing, scale, radius, part, at, points_of, inside, field, members_of, members, hinge_of):  # type: ignore[no-untyped-def]
    """(H,) metres of each hinge's field that bring their volumes back.

    Least squares: hinges that are near to each other move much the same surface, and the share of `_HELD` keeps them
    from working against each other.
    """
    count = len(missing)
    matrix, wanted = np.zeros((count, count)), np.zeros(count)
    for h in range(count):
        wanted[h] = part[h] * missing[h] / scale[h]
        if part[h] == 0:
            continue
        for a in range(points_of[h], points_of[h + 1]):
            if field[a] == 0:
                continue
            p = at[a]
            for b in range(members_of[p], members_of[p + 1]):
                k = members[b]
                other = hinge_of[k]
                if part[other] > 0 and inside[k]:
                    matrix[other, h] += areas[p] * field[a] * part[h] * part[other] * radius[h] / scale[other]
    rows, columns = matrix.sum(axis=1) + 1e-12, matrix.sum(axis=0) + 1e-12
    out = np.zeros(count)
    for _ in range(_SWEEPS):
        out += (matrix.T @ ((wanted - matrix @ out) / rows)) / columns
    return out * part * radius


@compiled
def _members(points_of, at, count):  # type: ignore[no-untyped-def]
    """Where each of count points is among those of the hinges, and the hinge of each of these."""
    starts, hinge_of = np.zeros(count + 1, np.int64), np.zeros(len(at), np.int64)
    for p in at:
        starts[p + 1] += 1
    for p in range(count):
        starts[p + 1] += starts[p]
    place, members = starts[:-1].copy(), np.zeros(len(at), np.int64)
    for h in range(len(points_of) - 1):
        for i in range(points_of[h], points_of[h + 1]):
            hinge_of[i] = h
            members[place[at[i]]] = i
            place[at[i]] += 1
    return starts, members, hinge_of


@compiled
def _keep(  # type: ignore[no-untyped-def]
    posed, first_of, point_of, surface, rotations, first, second, beyond, soft, volume, scale, joints, radius, ring_of,
    ring, along, points_of, at, side, spread, touch, inside, triangles_of, triangles, loops_of, borders_of, borders,
):  # fmt: skip
    count, hinges = len(first_of), len(radius)
    points, before, areas = np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 3))
    free, sizes, field = np.empty(count), np.empty(count), np.zeros(len(at))
    normals, inner, centres = np.empty((hinges, 3)), np.empty((hinges, 3)), np.empty((hinges, 3))
    missing, part = np.zeros(hinges), np.zeros(hinges)
    members_of, members, hinge_of = _members(points_of, at, count)
    for t in range(len(posed)):
        for p in range(count):
            points[p] = posed[t, first_of[p]]
        before[:] = points
        free[:] = 1
        for h in range(hinges):
            normals[h], inner[h], part[h] = _bend(first[h], second[h], rotations[t, joints[h, 0]],
                                                  rotations[t, joints[h, 1]])  # fmt: skip
        for turn in range(_ROUNDS + 1):
            for h in range(hinges):
                if part[h] > 0:
                    centres[h] = _centre(points, ring, along, ring_of[h], ring_of[h + 1])
                    _touching(points, centres[h], normals[h], inner[h] * part[h], points_of[h], points_of[h + 1],
                              radius[h], at, side, touch, beyond, soft, free)  # fmt: skip
            if turn == _ROUNDS:
                break
            _area_vectors(points, surface, areas)
            for p in range(count):
                sizes[p] = np.sqrt(areas[p] @ areas[p])
            for h in range(hinges):
                if part[h] > 0:
                    missing[h] = volume[h] - _volume(points, centres[h], triangles, triangles_of[h],
                                                     triangles_of[h + 1], borders_of, borders, loops_of[h],
                                                     loops_of[h + 1])  # fmt: skip
                    _field(points, centres[h], inner[h], missing[h], radius[h], points_of[h], points_of[h + 1], at,
                           spread, free, field)  # fmt: skip
            amounts = _amounts(sizes, missing, scale, radius, part, at, points_of, inside, field, members_of, members,
                               hinge_of)  # fmt: skip
            for h in range(hinges):
                if part[h] > 0:
                    amount = min(max(amounts[h], -_MOST * radius[h]), _MOST * radius[h])
                    for i in range(points_of[h], points_of[h + 1]):
                        p = at[i]
                        step = amount * field[i] / (sizes[p] + 1e-30)
                        for a in range(3):
                            points[p, a] += areas[p, a] * step
        for v in range(len(point_of)):
            p = point_of[v]
            for c in range(3):
                posed[t, v, c] += np.float32(points[p, c] - before[p, c])
