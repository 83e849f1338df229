"""A motion as the arrays and facts of a stage, and back."""

from muybridge.geometry.skeleton.motion import Motion
from muybridge.geometry.skeleton.skeleton import Skeleton
from muybridge.infer.runtime.stages import Arrays, Facts


def pack_motion(motion: Motion) -> tuple[Arrays, Facts]:
    """A motion as arrays and facts."""
    skeleton = motion.skeleton
    arrays = {
        "root_positions_world": motion.root_positions_world,
        "quat_wxyz": motion.quat_wxyz,
        "offsets": skeleton.offsets,
        "tips": skeleton.tips,
        "lower": skeleton.lower,
        "upper": skeleton.upper,
    }
    facts = {
        "fps": motion.fps,
        "names": skeleton.names,
        "parents": [int(p) for p in skeleton.parents],
        "twist_axis": [int(a) for a in skeleton.twist_axis],
    }
    return arrays, facts


def unpack_motion(arrays: Arrays, facts: Facts) -> Motion:
    """The motion that `pack_motion` made arrays and facts of; other arrays and facts are passed over."""
    skeleton = Skeleton(
        names=tuple(facts["names"]),
        parents=tuple(facts["parents"]),
        offsets=arrays["offsets"],
        tips=arrays["tips"],
        twist_axis=tuple(facts["twist_axis"]),
        lower=arrays["lower"],
        upper=arrays["upper"],
    )
    return Motion(skeleton, facts["fps"], arrays["root_positions_world"], arrays["quat_wxyz"])
