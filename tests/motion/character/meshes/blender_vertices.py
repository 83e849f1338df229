"""Where Blender sees the vertices of a file: `blender_vertices.py FILE OUT.npz FRAMES [READER]`, by a Python with bpy.

Stores the places of all vertices (T, V, 3) in Blender's world, the names of the pictures, and how many layers of
texture coordinates each mesh has. Not a test itself.
"""

import os
import sys

import bpy
import numpy as np

path, out, frames = sys.argv[1], sys.argv[2], int(sys.argv[3])
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
if path.endswith(".fbx") and sys.argv[4:5] == ["c"]:  # one reader is in Python, and since 4.5 there is one in C
    bpy.ops.wm.fbx_import(filepath=path)
elif path.endswith(".fbx"):
    bpy.ops.import_scene.fbx(filepath=path)
elif path.endswith((".usda", ".usdc", ".usdz")):
    bpy.ops.wm.usd_import(filepath=path)
else:
    bpy.ops.import_scene.gltf(filepath=path)
meshes = sorted((o for o in bpy.data.objects if o.type == "MESH" and o.modifiers), key=lambda o: o.name)
first = int(bpy.data.actions[0].frame_range[0]) if bpy.data.actions else 0
places = []
for frame in range(first, first + frames):
    scene.frame_set(frame)
    graph = bpy.context.evaluated_depsgraph_get()
    own = []
    for mesh in meshes:
        seen = mesh.evaluated_get(graph)
        values = np.empty(3 * len(seen.data.vertices))
        seen.data.vertices.foreach_get("co", values)
        world = np.array(seen.matrix_world)
        own.append(values.reshape(-1, 3) @ world[:3, :3].T + world[:3, 3])
    places.append(np.concatenate(own))
names = sorted(image.name.partition(".")[0] for image in bpy.data.images if image.size[0])
layers = [len(mesh.data.uv_layers) for mesh in meshes]
np.savez(out, vertices=np.array(places), pictures=np.array(names), uv_layers=np.array(layers))
sys.stdout.flush()
os._exit(0)  # some versions of the module crash while Python takes itself down
