"""Reach for a point with both hands: inverse kinematics within joint limits.

    python 08_inverse_kinematics.py motion.bvh

The skeleton is that of any motion file.
"""

import sys

import numpy as np

import muybridge

skeleton = muybridge.read_motion(sys.argv[1]).skeleton
tree, last_hinge = muybridge.tree_of_skeleton(skeleton)  # ball joints become three hinges

places = skeleton.forward(np.zeros((1, 3)), np.tile(np.eye(3), (1, len(skeleton), 1, 1)))[1][0]  # at rest
chest = places[skeleton.index("chest")]
target = chest + [0.0, -0.35, 0.1]  # in front of it, since a figure at rest faces -Y

goals = [
    muybridge.Goal(
        joint=int(last_hinge[skeleton.parents[skeleton.index(hand)]]),
        offset=skeleton.offsets[skeleton.index(hand)],  # the hand's place in the forearm's axes
        position=target + [side * 0.05, 0, 0],
    )
    for hand, side in (("left_hand", 1), ("right_hand", -1))
]
for method in ("damped", "ccd", "nonlinear"):
    found = muybridge.solve_ik(tree, goals, method=method)
    print(f"{method:10s} success {found.success}, {1000 * max(found.position_error):.2f} mm off")
