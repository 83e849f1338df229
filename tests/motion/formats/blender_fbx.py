"""FBX as Blender writes it: `python blender_fbx.py FILE.glb FPS OUT`, run by a Python that has bpy.

Writes OUT.fbx with its defaults, OUT-z.fbx with Z up, other bone axes and no mesh, and OUT.npz with the places of every
bone's head (T, B, 3) and the bones' names. Not a test itself.
"""

import os
import sys

import bpy
import numpy as np

path, fps, out = sys.argv[1], float(sys.argv[2]), sys.argv[3]
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps = round(fps)
bpy.ops.import_scene.gltf(filepath=path)
armature = next(o for o in bpy.data.objects if o.type == "ARMATURE")
scene.frame_start, scene.frame_end = 0, round(armature.animation_data.action.frame_range[1])
places = []
for frame in range(scene.frame_end + 1):
    scene.frame_set(frame)
    places.append([tuple(armature.matrix_world @ bone.head) for bone in armature.pose.bones])
np.savez(f"{out}.npz", places=np.array(places), names=np.array([b.name for b in armature.pose.bones]))
bpy.ops.export_scene.fbx(filepath=f"{out}.fbx", bake_anim_simplify_factor=0.0)
bpy.ops.export_scene.fbx(
    filepath=f"{out}-z.fbx", bake_anim_simplify_factor=0.0, axis_forward="-Y", axis_up="Z", primary_bone_axis="X",
    secondary_bone_axis="-Z", apply_scale_options="FBX_SCALE_ALL", add_leaf_bones=False, object_types={"ARMATURE"},
)  # fmt: skip
sys.stdout.flush()
os._exit(0)  # some versions of the module crash while Python takes itself down
