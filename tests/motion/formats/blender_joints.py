"""What Blender makes of a file: `blender_joints.py FILE FPS OUT.npz [READER [CLIP]]`, run by a Python that has bpy.

Stores the places of every bone's head (T, B, 3) in Blender's world, and the bones' names. Not a test itself.
"""

import os
import sys

import bpy
import numpy as np

path, fps, out = sys.argv[1], float(sys.argv[2]), sys.argv[3]
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps = max(round(fps), 1)
scene.render.fps_base = scene.render.fps / fps
if path.endswith(".bvh"):
    bpy.ops.import_anim.bvh(filepath=path)  # its defaults: scale 1, forward -Z, up Y
    first = 1
elif path.endswith(".fbx"):
    # Blender has two readers: one in Python, and since 4.5 one in C.
    if sys.argv[4:5] == ["c"]:
        bpy.ops.wm.fbx_import(filepath=path)
    else:
        bpy.ops.import_scene.fbx(filepath=path, anim_offset=0.0)
    first = 0
else:
    bpy.ops.import_scene.gltf(filepath=path)
    first = 0
armatures = [o for o in bpy.data.objects if o.type == "ARMATURE"]
assert len(armatures) == 1, armatures
armature = armatures[0]
if sys.argv[5:] and sys.argv[5]:  # one of several clips
    chosen = next(a for a in bpy.data.actions if sys.argv[5] in a.name)
    armature.animation_data.action = chosen
    if hasattr(chosen, "slots"):  # since 4.4
        armature.animation_data.action_slot = chosen.slots[0]
    for track in armature.animation_data.nla_tracks:
        track.mute = True
action = armature.animation_data.action
last = round(action.frame_range[1])
places = []
for frame in range(first, last + 1):
    scene.frame_set(frame)
    places.append([tuple(armature.matrix_world @ bone.head) for bone in armature.pose.bones])
meshes = [o for o in bpy.data.objects if o.type == "MESH"]
bound = [m.name for m in meshes if any(x.type == "ARMATURE" and x.object == armature for x in m.modifiers)]
if bound:  # the skin follows: its vertices at the last frame, with the bone each is bound to
    mesh = next(m for m in meshes if m.name == bound[0])
    seen = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
    vertices = [tuple(mesh.matrix_world @ v.co) for v in seen.data.vertices]
    groups = [mesh.vertex_groups[v.groups[0].group].name for v in mesh.data.vertices]
else:
    vertices, groups = [], []
np.savez(
    out,
    places=np.array(places),
    names=np.array([b.name for b in armature.pose.bones]),
    vertices=np.array(vertices),
    groups=np.array(groups),
)
sys.stdout.flush()
os._exit(0)  # some versions of the module crash while Python takes itself down
