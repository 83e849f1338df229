"""Damaged files fed to a reader; run as a module in a process of its own, a crash of which shows."""

import sys
import time
import warnings
import zlib
from pathlib import Path

import numpy as np

from muybridge.errors import MuybridgeError
from tests.fuzz.mutators import mutated
from tests.fuzz.readers import READERS

_SECONDS = 2.0


def fuzz(name: str, folder: Path, count: int, seed: int = 0) -> tuple[int, int]:
    """Feed a reader damaged files.

    Args:
        name: of the reader.
        folder: for the files; the last damaged one stays there.
        count: of damaged files.
        seed: of the damage.

    Returns:
        How many were read, and how many refused.

    Raises:
        AssertionError: an error that is no MuybridgeError or not one line that names the file, a read that takes
            long, or a result that is not sound.
    """
    reader = READERS[name]
    path = reader.write(folder)
    good = path.read_bytes()
    reader.check(reader.read(path))
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    fine = refused = 0
    for k in range(count):
        path.write_bytes(mutated(good, rng, reader.kind))
        where, start = f"damaged file {k} of {name} ({path})", time.process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                reader.check(reader.read(path))
            fine += 1
        except MuybridgeError as error:
            refused += 1
            text = str(error)
            assert path.name in text or path.parent.name in text, f"{where}: not named: {text[:300]}"
            assert "\n" not in text and len(text) < 2000, f"{where}: {len(text)} characters: {text[:300]!r}"
        except AssertionError as error:
            raise AssertionError(f"{where}: not sound: {error}") from error
        except Exception as error:
            raise AssertionError(f"{where}: {type(error).__name__}: {error}") from error
        took = time.process_time() - start
        assert took < _SECONDS, f"{where}: took {took:.1f} s"
    return fine, refused


if __name__ == "__main__":
    print(*fuzz(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])))
