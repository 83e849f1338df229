"""The trunk between legs and arms, the neck and head above it, and the fingers of a hand."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.roles.limbs import finger_chains
from muybridge.geometry.roles.tree import Tree, lowest_common
from muybridge.geometry.skeleton.profiles import FINGERS

_CENTRAL = 0.35  # sideways over upwards: more is no neck
_NECK = 0.3  # of the trunk: two joints above the chest that are closer than this to each other are neck and head


def trunk_roles(tree: Tree, hips: int, chest: int) -> dict[str, int]:
    """Roles of the joints from below the hips up to the one that the arms hang from."""
    path = tree.above(chest)
    path = path[: path.index(hips)][::-1] if hips in path else _beside(tree, hips, chest)
    if not path:
        return {}
    if len(path) == 1:
        return {"chest": path[0]}
    if len(path) == 2:
        return {"spine": path[0], "chest": path[1]}
    return {"spine": path[0], "chest": path[len(path) // 2], "upper_chest": path[-1]}


def _beside(tree: Tree, hips: int, chest: int) -> list[int]:
    """The trunk where hips and spine are siblings: what is below the joint that both hang from."""
    common = lowest_common(tree, [hips, chest])
    path = tree.above(chest)
    return path[: path.index(common)][::-1] if common >= 0 else path[::-1]


def head_chain(tree: Tree, chest: int, limbs: set[int], up: FloatArray, side: FloatArray) -> list[int]:
    """The joints above the joint that the arms hang from, the topmost last; empty where nothing rises there.

    Args:
        tree: of the skeleton.
        chest: the joint that the arms hang from.
        limbs: the top joints of the arms and legs, which are passed over.
        up: (3,) unit.
        side: (3,) unit, from one side of the body to the other.
    """
    best: tuple[float, list[int]] = (0.0, [])
    for child in tree.children[chest]:
        if child in limbs:
            continue
        chain = _rising(tree, child, up, side)
        rise = max(float((tree.end(j) - tree.at[chest]) @ up) for j in chain)
        sideways = abs(float((tree.at[chain[-1]] - tree.at[chest]) @ side))
        if rise > 0 and sideways < _CENTRAL * rise + 0.01 * tree.size and rise > best[0]:
            best = rise, chain
    return best[1]


def _rising(tree: Tree, j: int, up: FloatArray, side: FloatArray) -> list[int]:
    """From a joint along the branch that rises highest, near the middle, at every fork."""
    chain = [j]
    while options := tree.children[chain[-1]]:
        here = tree.at[chain[-1]]

        def rise(c: int, here: FloatArray = here) -> float:
            top = max(float((tree.end(k) - here) @ up) for k in tree.below(c))
            return top - 2 * abs(float((tree.at[c] - here) @ side))

        best = max(options, key=rise)
        if rise(best) <= 0:
            break
        chain.append(best)
    return chain


def head_roles(tree: Tree, chain: list[int], trunk: float, ends: bool) -> dict[str, int]:
    """Neck and head among the joints above the chest.

    Args:
        tree: of the skeleton.
        chain: those joints, the topmost last.
        trunk: metres from hips to shoulders.
        ends: whether the skeleton's other chains end with a joint that marks the end of a bone.
    """
    if not chain:
        return {}
    for k, j in enumerate(chain):
        # Eyes, ears, a jaw or hair: where the chain forks is the head.
        if len(tree.children[j]) > 1:
            return {"head": j} | ({"neck": chain[0]} if k else {})
    bare = chain[-1]
    if len(chain) == 1:
        return {"head": bare}
    known_tip = bool(np.isfinite(tree.tips[bare]).all()) and float(np.linalg.norm(tree.tips[bare])) > 0
    last = len(chain) - 1
    if not known_tip and (ends or tree.lengths[bare] > _NECK * trunk):
        last -= 1  # an end bone without its own length
    return {"head": chain[last]} | ({"neck": chain[0]} if last else {})


def finger_roles(tree: Tree, hand: int, forearm: FloatArray) -> dict[str, int]:
    """`thumb_1` ... `little_3` of a hand, by where they start and point; nothing where they cannot be told apart.

    Args:
        tree: of the skeleton.
        hand: the joint of the wrist.
        forearm: (3,) unit, from elbow to wrist.
    """
    chains = [_phalanges(tree, hand, c) for c in finger_chains(tree, hand)]
    chains = [c for c in chains if len(c) >= 2 or len(chains) >= 4]
    if len(chains) == 1:
        return _named({"middle": chains[0]})
    if not 2 <= len(chains) <= 5:
        return {}
    # The thumb leaves the hand earliest and farthest to the side.
    forward = [float((tree.at[c[0]] - tree.at[hand]) @ forearm) for c in chains]
    thumb = int(np.argmin(forward))
    rest = [c for k, c in enumerate(chains) if k != thumb]
    centre = np.mean([tree.at[c[0]] for c in rest], axis=0)
    across = tree.at[chains[thumb][0]] - centre
    across = across - (across @ forearm) * forearm
    if len(rest) > 1:
        line = np.array([tree.at[c[0]] - centre for c in rest])
        spread = np.linalg.svd(line)[2][0]
        across = spread * np.sign(spread @ across or 1.0)
    rest.sort(key=lambda c: -float(tree.at[c[0]] @ across))
    names = {1: ("middle",), 2: ("index", "middle"), 3: ("index", "middle", "little"), 4: FINGERS[1:]}[len(rest)]
    return _named({"thumb": chains[thumb]} | dict(zip(names, rest, strict=True)))


def _named(chains: dict[str, list[int]]) -> dict[str, int]:
    return {f"{name}_{k}": j for name, chain in chains.items() for k, j in enumerate(chain[:3], start=1)}


def _phalanges(tree: Tree, hand: int, chain: list[int]) -> list[int]:
    """A finger's chain without metacarpal and end bone."""
    if len(chain) <= 3:
        return chain
    gap = float(np.linalg.norm(tree.at[chain[0]] - tree.at[hand]))
    return chain[1:4] if len(chain) > 4 or gap < 0.5 * tree.lengths[chain[1]] else chain[:3]
