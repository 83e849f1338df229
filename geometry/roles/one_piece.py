"""Figures whose legs and arms are of one piece each, as toys and simple game characters have them."""

import numpy as np

from muybridge.arrays import FloatArray
from muybridge.geometry.roles.tree import Tree, lowest_common

_ALIKE = 0.35  # of the distance between two joints: what their places may differ by in other directions
_APART = 0.1  # of the skeleton's size: a pair is at least so wide


def one_piece_limbs(tree: Tree) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """The two legs and the two arms of a figure without knees and elbows; None where it is no such figure.

    Both are pairs of joints without further joints, which hang side by side from one joint; the arms' is the legs' one
    or a joint above the legs, apart from them.
    """
    pairs = [(a, b) for joints in tree.children for a in joints for b in joints if a < b and _side_by_side(tree, a, b)]
    best = None
    for legs in pairs:
        for arms in pairs:
            if set(legs) & set(arms):
                continue
            rise = tree.at[list(arms)].mean(axis=0) - tree.at[list(legs)].mean(axis=0)
            across = _across(tree, legs), _across(tree, arms)
            level = abs(float(across[0] @ across[1]))
            # Arms hang above the legs, farther from the joint that carries both, and level with them.
            common = lowest_common(tree, [*legs, *arms])
            deeper = tree.parents[arms[0]] != common and tree.parents[legs[0]] == common
            height = float(np.linalg.norm(rise))
            if level < 1 - _ALIKE or not deeper or height < _APART * tree.size:
                continue
            if best is None or height > best[0]:
                best = height, legs, arms
    return None if best is None else (best[1], best[2])


def _across(tree: Tree, pair: tuple[int, int]) -> FloatArray:
    gap = tree.at[pair[0]] - tree.at[pair[1]]
    return np.asarray(gap / np.linalg.norm(gap))


def _side_by_side(tree: Tree, a: int, b: int) -> bool:
    if tree.children[a] or tree.children[b]:
        return False
    gap = tree.at[a] - tree.at[b]
    wide = float(np.linalg.norm(gap))
    if wide < _APART * tree.size:
        return False
    middle = (tree.at[a] + tree.at[b]) / 2 - tree.at[tree.parents[a]]
    return abs(float(middle @ gap)) / wide < _ALIKE * wide / 2
