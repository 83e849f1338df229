"""Read a motion in any format, look at it, and write it in another.

python 04_read_and_convert_motion.py walk.bvh walk.glb joints.trc
"""

import sys

import numpy as np

import muybridge

source, target, joints = sys.argv[1:4]
motion = muybridge.read_motion(source)  # metres, Z up, whatever the file uses
print(f"{len(motion)} frames at {motion.fps:g} frames/s, {len(motion.skeleton)} joints")

places = motion.joint_positions_world()  # (frames, joints, 3), by forward kinematics
root = places[:, 0]
path = np.linalg.norm(np.diff(root[:, :2], axis=0), axis=1).sum()
print(
    f"{motion.skeleton.names[0]} travels {path:.2f} m over the floor and is {root[:, 2].mean():.2f} m high on average"
)

# The first second only: a Motion is a plain, frozen object.
first = muybridge.Motion(
    motion.skeleton,
    motion.fps,
    motion.root_positions_world[: round(motion.fps)],
    motion.quat_wxyz[: round(motion.fps)],
)
muybridge.write_motion(target, first)
muybridge.write_motion(joints, first)  # a format of points gets the joints' positions
