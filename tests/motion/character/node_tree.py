"""A glTF file evaluated by the words of the specification, apart from the toolkit: nodes, skins, vertices.

Plain GLB files with one buffer; times in seconds; results in the world (Z up).
"""

import json
import struct
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

WORLD_FROM_GLTF = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
DTYPES = {5126: "<f4", 5121: "<u1", 5123: "<u2", 5125: "<u4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class Tree:
    """The nodes of a GLB at one time of one of its animations (None: without)."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        size = struct.unpack_from("<I", data, 12)[0]
        self.text, self.binary = data[20 : 20 + size].decode(), data[28 + size :]
        self.json = json.loads(self.text)
        self.parents = {c: i for i, n in enumerate(self.json["nodes"]) for c in n.get("children", [])}

    def array(self, index: int) -> np.ndarray:
        accessor = self.json["accessors"][index]
        view = self.json["bufferViews"][accessor["bufferView"]]
        dtype, width = np.dtype(DTYPES[accessor["componentType"]]), WIDTHS[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        stride = view.get("byteStride", dtype.itemsize * width)
        raw = np.ndarray((accessor["count"], width), dtype, self.binary, start, (stride, dtype.itemsize))
        values = raw.astype(float)
        return values / np.iinfo(dtype).max if accessor.get("normalized") else values

    def clip(self, name: str) -> int:
        return [a.get("name") for a in self.json["animations"]].index(name)

    def start(self, clip: int) -> float:
        """The time of its first key."""
        samplers = self.json["animations"][clip]["samplers"]
        return min(float(self.array(s["input"])[0, 0]) for s in samplers)

    def at(self, clip: int | None, time: float) -> list[np.ndarray]:
        """(4, 4) scene from each node."""
        local = []
        for node in self.json["nodes"]:
            parts = {"t": node.get("translation", [0, 0, 0]), "r": node.get("rotation", [0, 0, 0, 1]),
                     "s": node.get("scale", [1, 1, 1]), "m": node.get("matrix")}  # fmt: skip
            local.append(parts)
        if clip is not None:
            animation = self.json["animations"][clip]
            for channel in animation["channels"]:
                sampler, target = animation["samplers"][channel["sampler"]], channel["target"]
                what = target["path"][0]
                if what != "w":
                    values = self._value(sampler, time, what == "r")
                    local[target["node"]][what] = values
        out: dict[int, np.ndarray] = {}

        def world(n: int) -> np.ndarray:
            if n not in out:
                parts, matrix = local[n], np.eye(4)
                if parts["m"] is not None:
                    matrix = np.array(parts["m"], float).reshape(4, 4).T
                else:
                    matrix[:3, :3] = Rotation.from_quat(parts["r"]).as_matrix() @ np.diag(np.array(parts["s"], float))
                    matrix[:3, 3] = parts["t"]
                out[n] = world(self.parents[n]) @ matrix if n in self.parents else matrix
            return out[n]

        return [world(n) for n in range(len(local))]

    def _value(self, sampler: dict, time: float, rotation: bool) -> np.ndarray:
        keys, values = self.array(sampler["input"])[:, 0], self.array(sampler["output"])
        time = min(max(time, keys[0]), keys[-1])
        if sampler.get("interpolation") == "STEP" or len(keys) == 1:
            return values[max(int(np.searchsorted(keys, time + 1e-6, side="right")) - 1, 0)]
        if rotation:
            return Slerp(keys, Rotation.from_quat(values))(time).as_quat()
        return np.array([np.interp(time, keys, column) for column in values.T])

    def joints(self, names: tuple[str, ...], clip: int | None, time: float) -> np.ndarray:
        """(J, 3) in the world: the nodes of these names."""
        frames = self.at(clip, time)
        index = {n.get("name", f"node_{i}"): i for i, n in enumerate(self.json["nodes"])}
        return np.array([frames[index[name]][:3, 3] for name in names]) @ WORLD_FROM_GLTF.T

    def vertices(self, clip: int | None, time: float) -> list[np.ndarray]:
        """(V, 3) in the world of every primitive of every node with a mesh, in the order of the nodes."""
        frames, out = self.at(clip, time), []
        for n, node in enumerate(self.json["nodes"]):
            if "mesh" not in node:
                continue
            for part in self.json["meshes"][node["mesh"]]["primitives"]:
                attributes = part["attributes"]
                points = self.array(attributes["POSITION"])
                points = np.concatenate([points, np.ones((len(points), 1))], axis=1)
                if "skin" in node:
                    skin = self.json["skins"][node["skin"]]
                    inverse = self.array(skin["inverseBindMatrices"]).reshape(-1, 4, 4).swapaxes(1, 2)
                    maps = np.array([frames[j] @ m for j, m in zip(skin["joints"], inverse, strict=True)])
                    joints = self.array(attributes["JOINTS_0"]).astype(int)
                    weights = self.array(attributes["WEIGHTS_0"])
                    of_vertex = np.einsum("vk,vkab->vab", weights / weights.sum(1, keepdims=True), maps[joints])
                    moved = np.einsum("vab,vb->va", of_vertex, points)
                else:
                    moved = points @ frames[n].T
                out.append(moved[:, :3] @ WORLD_FROM_GLTF.T)
        return out
