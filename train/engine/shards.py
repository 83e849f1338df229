"""Stores of generated arrays: folders of numbered shards, each made once from the store's seed and its own number."""

import pathlib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from muybridge.files import replacing

Arrays = dict[str, NDArray[Any]]


def shard_path(folder: pathlib.Path, number: int) -> pathlib.Path:
    """Path of a shard."""
    return folder / f"{number:05}.npz"


def missing_shards(folder: pathlib.Path, numbers: Iterable[int]) -> list[int]:
    """Those of `numbers` of which `folder` has no shard yet."""
    return [number for number in numbers if not shard_path(folder, number).exists()]


def save_shard(folder: pathlib.Path, number: int, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write a shard; it appears only when it is complete."""
    with replacing(shard_path(folder, number)) as temporary, temporary.open("wb") as file:
        np.savez(file, **dict(arrays))  # type: ignore[arg-type]


def read_shards(
    folder: pathlib.Path, numbers: range, keys: Iterable[str], names: tuple[str, ...] | None = None
) -> Iterator[Arrays]:
    """The shards of `folder` that are in `numbers`, in order.

    Args:
        folder: the store.
        numbers: of the shards.
        keys: of the arrays to read.
        names: shards whose array `names` differs, such as those of another marker set, are skipped.
    """
    keys = tuple(keys)
    for path in sorted(folder.glob("*.npz")):
        if path.stem.isdecimal() and int(path.stem) in numbers:
            with np.load(path) as shard:
                if names is None or tuple(shard["names"].tolist()) == names:
                    yield {key: shard[key] for key in keys}


def concatenate(shards: Iterable[Arrays], empty: Arrays) -> Arrays:
    """The arrays of all shards in one, after those of `empty`, which give shapes and types where there is no shard."""
    parts = [empty, *shards]
    return {key: np.concatenate([part[key] for part in parts]) for key in empty}
