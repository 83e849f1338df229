"""Several inputs in one call, of which some may fail: the others are still processed."""

import sys
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from muybridge.errors import MuybridgeError

T = TypeVar("T")


@dataclass(frozen=True)
class Tried(Generic[T]):
    """What became of several inputs.

    Attributes:
        done: results by input, of those that did not fail.
        failed: the others.
        exit_code: 0; 2 where one failed, 1 where that was a bug.
    """

    done: dict[Path, T]
    failed: tuple[Path, ...]
    exit_code: int

    def report_failures(self, what: str) -> None:
        """Print which inputs failed, if any did; `what` they are, in the plural."""
        if self.failed:
            count, names = len(self.failed) + len(self.done), ", ".join(str(path) for path in self.failed)
            print(f"error: {len(self.failed)} of {count} {what} failed: {names}; see above", file=sys.stderr)


def try_each(paths: Sequence[Path], work: Callable[[Path], T], tell: Callable[[MuybridgeError], object]) -> Tried[T]:
    """Process every input, whatever happens to the others.

    Args:
        paths: the inputs, no two the same.
        work: what is done with each.
        tell: called with an input's error as soon as it happens.

    Raises:
        MuybridgeError: the only input failed.
    """
    if len(paths) == 1:
        return Tried({paths[0]: work(paths[0])}, (), 0)
    done: dict[Path, T] = {}
    failed: list[Path] = []
    bug = False
    for path in paths:
        try:
            done[path] = work(path)
        except MuybridgeError as error:
            tell(error)
            failed.append(path)
        except Exception:
            traceback.print_exc()
            failed.append(path)
            bug = True
    return Tried(done, tuple(failed), 1 if bug else 2 if failed else 0)
