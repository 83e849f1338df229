"""Figures of overlapping capsules whose joints are known: a person in three poses, and an animal."""

import numpy as np
from scipy.spatial.transform import Rotation

HEIGHT = 1.75


def capsule(start, stop, first: float, last: float, rings: int = 8, around: int = 14):
    """Vertices and triangles of a capsule from `start` to `stop`, with a radius at each end."""
    start, stop = np.asarray(start, float), np.asarray(stop, float)
    along = stop - start
    length = np.linalg.norm(along)
    turn = Rotation.align_vectors([along / length], [[0, 0, 1.0]])[0].as_matrix()
    points = [np.array([[0, 0, -first]])]
    angles = np.linspace(0, 2 * np.pi, around, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    for a in np.linspace(-np.pi / 2, 0, rings // 2 + 1)[1:]:
        points.append(circle * first * np.cos(a) + [0, 0, first * np.sin(a)])
    for a in np.linspace(0, np.pi / 2, rings // 2 + 1)[:-1]:
        points.append(circle * last * np.cos(a) + [0, 0, length + last * np.sin(a)])
    points.append(np.array([[0, 0, length + last]]))
    count, faces = len(points) - 2, []
    for k in range(around):
        n = (k + 1) % around
        faces.append([0, 1 + n, 1 + k])
        for r in range(count - 1):
            a, b = 1 + r * around, 1 + (r + 1) * around
            faces += [[a + k, a + n, b + n], [a + k, b + n, b + k]]
        faces.append([1 + (count - 1) * around + k, 1 + (count - 1) * around + n, 1 + count * around])
    return np.concatenate(points) @ turn.T + start, np.array(faces)


def together(parts):
    """One mesh of several."""
    starts = np.cumsum([0, *(len(v) for v, _ in parts[:-1])])
    return (np.concatenate([v for v, _ in parts]),
            np.concatenate([f + s for (_, f), s in zip(parts, starts, strict=True)]).astype(np.int64))  # fmt: skip


def person(below_deg: float = 40.0):
    """Vertices, triangles and joints of a person whose arms are so far below the horizontal; facing -Y, Z up."""
    a = np.radians(below_deg)
    down = np.array([np.cos(a), -0.03, -np.sin(a)])
    joints = {"neck": [0, 0.01, 1.49], "head": [0, -0.01, 1.59], "hips": [0, 0, 0.93]}
    parts = [
        capsule([0, 0, 1.0], [0, 0.0, 1.28], 0.13, 0.13), capsule([-0.09, 0, 1.32], [0.09, 0, 1.32], 0.1, 0.1),
        capsule([0, 0.0, 1.4], [0, -0.01, 1.58], 0.06, 0.06), capsule([0, -0.02, 1.6], [0, -0.02, 1.66], 0.09, 0.09),
        capsule([0, -0.11, 1.6], [0, -0.125, 1.59], 0.02, 0.015),
    ]  # fmt: skip
    for side, sign in (("left", 1.0), ("right", -1.0)):
        m = np.array([sign, 1, 1])
        shoulder = np.array([0.18, 0.0, 1.39])
        elbow, wrist, tip = (shoulder + d * down for d in (0.26, 0.51, 0.68))
        hip, knee, ankle = np.array([0.1, 0, 0.93]), np.array([0.12, -0.01, 0.52]), np.array([0.13, 0.02, 0.1])
        toe, end = np.array([0.14, -0.1, 0.04]), np.array([0.145, -0.16, 0.035])
        parts += [capsule(a * m, b * m, r, s) for a, b, r, s in (
            (shoulder, elbow, 0.06, 0.045), (elbow, wrist, 0.045, 0.03), (wrist, tip, 0.04, 0.03),
            (hip, knee, 0.095, 0.06), (knee, ankle, 0.06, 0.04), (ankle, toe, 0.045, 0.04), (toe, end, 0.035, 0.03),
            (ankle + [0, 0.03, -0.06], ankle, 0.04, 0.04))]  # fmt: skip
        for role, place in (("upper_arm", shoulder), ("forearm", elbow), ("hand", wrist), ("thigh", hip),
                            ("shin", knee), ("foot", ankle), ("toe", toe)):  # fmt: skip
            joints[f"{side}_{role}"] = place * m
    vertices, triangles = together(parts)
    return vertices, triangles, {role: np.asarray(p, float) for role, p in joints.items()}


def hand():
    """Vertices, triangles, wrist, tip and finger -> (knuckle, end) of an open hand that points to +X, thumb to -Y."""
    parts = [capsule([-0.08, 0, 0], [0.0, 0, 0], 0.027, 0.025), capsule([0.01, 0, 0], [0.06, 0, 0], 0.025, 0.03)]
    fingers = {}
    for finger, y, spread, length in (("index", -0.03, -0.1, 0.08), ("middle", -0.01, 0.0, 0.09),
                                      ("ring", 0.012, 0.08, 0.082), ("little", 0.032, 0.2, 0.065)):  # fmt: skip
        start = np.array([0.085, y, 0.0])
        stop = start + length * np.array([np.cos(spread), np.sin(spread), 0.0])
        fingers[finger] = start, stop
        parts.append(capsule(start - [0.02, 0, 0], stop, 0.009, 0.007))
    fingers["thumb"] = np.array([0.025, -0.02, 0.0]), np.array([0.075, -0.075, 0.0])
    parts.append(capsule(*fingers["thumb"], 0.012, 0.009))
    vertices, triangles = together(parts)
    return vertices, triangles, np.zeros(3), np.array([0.18, 0, 0]), fingers


def animal():
    """Vertices and triangles of an animal on four legs with a head and a tail, facing -Y."""
    parts = [
        capsule([0, -0.35, 0.6], [0, 0.35, 0.58], 0.15, 0.14), capsule([0, -0.4, 0.66], [0, -0.6, 0.85], 0.08, 0.07),
        capsule([0, -0.6, 0.87], [0, -0.85, 0.8], 0.08, 0.04), capsule([0, 0.45, 0.62], [0, 0.95, 0.6], 0.03, 0.02),
    ]  # fmt: skip
    for x in (-0.12, 0.12):
        for y, bend in ((-0.35, 0.03), (0.38, 0.08)):
            knee = [x, y - bend, 0.3]
            parts += [capsule([x, y, 0.52], knee, 0.07, 0.04), capsule(knee, [x, y, 0.05], 0.04, 0.03),
                      capsule([x, y, 0.03], [x, y - 0.08, 0.025], 0.03, 0.025)]  # fmt: skip
    return together(parts)
