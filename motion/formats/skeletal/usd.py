"""USD Skel, as text (`.usda`): a skeleton, its animation and a mesh of its bones; written, not read.

Metres, Y up, facing +Z at rest, as in our glTF. A time code is a frame. Joints are written in the file's axes at rest,
not in their own.

Source: Pixar, UsdSkel: Schemas In-Depth, OpenUSD documentation.
"""

import re
from pathlib import Path

import numpy as np

from muybridge import __version__
from muybridge.arrays import FloatArray
from muybridge.files import replacing
from muybridge.geometry.numerics.rotations import continuous_quat
from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.motion.formats.skeletal.bone_meshes import bone_mesh
from muybridge.motion.formats.skeletal.bvh import BVH_FROM_WORLD


def write_usda(path: Path, motion: Motion) -> None:
    """Write a motion with its skeleton and a mesh of its bones.

    Args:
        path: the file to write; replaced only once it is complete.
        motion: metres, Z up; at least one frame.

    Raises:
        OutputError: the file cannot be written.
    """
    if not len(motion):
        raise ValueError("a motion without frames cannot be written")
    skeleton = motion.skeleton
    joints = ", ".join(f'"{name}"' for name in joint_paths(skeleton))
    text = _TEMPLATE.format(
        version=__version__,
        last=len(motion) - 1,
        fps=f"{motion.fps:.10g}",
        joints=joints,
        names=", ".join(f'"{n}"' for n in (re.sub(r'[\\"\n]', "_", n) for n in skeleton.names)),
        bind=_matrices(skeleton.rest_positions),
        rest=_matrices(np.concatenate([np.zeros((1, 3)), skeleton.offsets[1:]])),
        mesh=_mesh(skeleton),
        scales=", ".join(["(1, 1, 1)"] * len(skeleton)),
        animation=_animation(motion),
    )
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def joint_paths(skeleton: Skeleton) -> list[str]:
    """The joints as USD names them: paths from the root, of words that are identifiers."""
    words: list[str] = []
    for name in skeleton.names:
        word = re.sub(r"\W", "_", name, flags=re.ASCII) or "_"
        word = f"_{word}" if word[0].isdigit() else word
        words.append(word if word not in words else f"{word}_{len(words)}")
    paths: list[str] = []
    for word, parent in zip(words, skeleton.parents, strict=True):
        paths.append(word if parent < 0 else f"{paths[parent]}/{word}")
    return paths


def _numbers(values: FloatArray) -> str:
    return "(" + ", ".join(f"{v:.7g}" for v in values + 0.0) + ")"


def _matrices(places: FloatArray) -> str:
    """Translations as USD's matrices, whose vectors are rows."""
    last = [_numbers(np.append(BVH_FROM_WORLD @ place, 1.0)) for place in places]
    return ", ".join(f"((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), {row})" for row in last)


def _mesh(skeleton: Skeleton) -> str:
    mesh = bone_mesh(skeleton)
    points, normals = mesh.positions @ BVH_FROM_WORLD.T, mesh.normals @ BVH_FROM_WORLD.T
    count = len(points)
    lines = [
        f"int[] faceVertexCounts = [{', '.join(['3'] * (count // 3))}]",
        f"int[] faceVertexIndices = [{', '.join(map(str, range(count)))}]",
        f"point3f[] points = [{', '.join(map(_numbers, points))}]",
        f"normal3f[] normals = [{', '.join(map(_numbers, normals))}] (",
        '    interpolation = "vertex"',
        ")",
        f"float3[] extent = [{_numbers(points.min(axis=0))}, {_numbers(points.max(axis=0))}]",
        f"int[] primvars:skel:jointIndices = [{', '.join(map(str, mesh.joints))}] (",
        "    elementSize = 1",
        '    interpolation = "vertex"',
        ")",
        f"float[] primvars:skel:jointWeights = [{', '.join(['1'] * count)}] (",
        "    elementSize = 1",
        '    interpolation = "vertex"',
        ")",
    ]
    return "\n".join(f"        {line}" for line in lines)


def _animation(motion: Motion) -> str:
    quat = continuous_quat(motion.quat_wxyz)
    quat = quat / np.linalg.norm(quat, axis=-1, keepdims=True)
    quat[..., 1:] = quat[..., 1:] @ BVH_FROM_WORLD.T
    sliding = motion.skeleton.sliding
    offsets = [_numbers(BVH_FROM_WORLD @ o) for o in motion.skeleton.offsets[1:]]
    root = motion.root_positions_world @ BVH_FROM_WORLD.T
    slides = np.zeros((len(motion), 0, 3)) if motion.translations is None else motion.translations @ BVH_FROM_WORLD.T
    places = []
    for t, place in enumerate(root):
        row = [_numbers(place), *offsets]
        for k, j in enumerate(sliding):
            row[j] = _numbers(slides[t, k])
        places.append(row)
    out = ["        quatf[] rotations.timeSamples = {"]
    out += [f"            {t}: [{', '.join(map(_numbers, frame))}]," for t, frame in enumerate(quat)]
    out += ["        }", "        float3[] translations.timeSamples = {"]
    out += [f"            {t}: [{', '.join(row)}]," for t, row in enumerate(places)]
    return "\n".join([*out, "        }"])


_TEMPLATE = """#usda 1.0
(
    defaultPrim = "person"
    doc = "written by muybridge {version}"
    startTimeCode = 0
    endTimeCode = {last}
    framesPerSecond = {fps}
    timeCodesPerSecond = {fps}
    metersPerUnit = 1
    upAxis = "Y"
)

def SkelRoot "person"
{{
    def Skeleton "skeleton" (
        prepend apiSchemas = ["SkelBindingAPI"]
    )
    {{
        uniform token[] joints = [{joints}]
        uniform token[] jointNames = [{names}]
        uniform matrix4d[] bindTransforms = [{bind}]
        uniform matrix4d[] restTransforms = [{rest}]
        rel skel:animationSource = </person/motion>
    }}

    def Mesh "bones" (
        prepend apiSchemas = ["SkelBindingAPI"]
    )
    {{
        uniform token subdivisionScheme = "none"
        color3f[] primvars:displayColor = [(0.8, 0.62, 0.36)]
        rel skel:skeleton = </person/skeleton>
{mesh}
    }}

    def SkelAnimation "motion"
    {{
        uniform token[] joints = [{joints}]
        half3[] scales = [{scales}]
{animation}
    }}
}}
"""
