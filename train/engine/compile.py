"""`torch.compile` where it helps and works: it fuses operations into few passes over memory."""

from collections.abc import Callable
from typing import TypeVar

import torch

# Compiling takes half a minute, which a run of this length saves.
PAYS_AFTER_MINUTES = 5.0

_Function = TypeVar("_Function", bound=Callable[..., object])


def compile_for_training(function: _Function, minutes: float) -> _Function:
    """`function` compiled at its first call with arguments of a shape, or unchanged.

    It stays unchanged in runs of too few `minutes` to save what compiling takes, on a GPU, and where torch cannot
    compile because there is no C++ compiler or Python's headers are missing.
    """
    if minutes < PAYS_AFTER_MINUTES or torch.cuda.is_available() or not _compiler_works():
        return function
    out: _Function = torch.compile(function, dynamic=False)  # type: ignore[assignment]
    return out


def _compiler_works() -> bool:
    try:
        torch.compile(torch.neg)(torch.ones(64))
    except Exception as error:  # training continues without it, whatever is missing
        # The first line of inductor's errors says only that there is one.
        lines = [line for line in str(error).splitlines() if line.strip() and not line.endswith("raised:")]
        why = lines[0].strip() if lines else type(error).__name__
        print(f"training without torch.compile, an eighth slower: {why}", flush=True)
        return False
    return True
