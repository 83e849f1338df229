"""Learn a style from takes, and solve a pose in it from one goal.

    python 12_learn_a_style.py OUT.style TAKE...

All takes are of one skeleton.
"""

import sys
from pathlib import Path

import muybridge
from muybridge.geometry.roles import find_motion_roles
from muybridge.motion.style import examples_of, learn_style, save_style, solve_pose

takes = {path: muybridge.read_motion(path) for path in sys.argv[2:]}
first, *others = (examples_of(path, take) for path, take in takes.items())
for other in others:
    first = first.merged(other)
take = next(iter(takes.values()))
style = learn_style(first, find_motion_roles(take).roles)
save_style(Path(sys.argv[1]), style)

hand = take.joint_positions_world()[0, style.roles["right_hand"]]
solved = solve_pose(style, take.select([0]), {"right_hand": hand + [0, 0, 0.1]})
print(f"{style.examples} examples; the hand is {1e3 * solved.errors['right_hand']:.2f} mm off its goal")
