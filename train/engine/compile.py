"""Operations fused into few loops over memory (`torch.compile`), where a machine can."""

from collections.abc import Callable
from typing import TypeVar

import torch

# Compiling takes half a minute, and so much time comes back in so many minutes.
PAYS_AFTER_MINUTES = 5.0

_Function = TypeVar("_Function", bound=Callable[..., object])


def compiled(function: _Function, minutes: float) -> _Function:
    """`function` compiled at its first call with arguments of a shape, or as it is: in a run of a few `minutes`, which
    it would only delay, on a GPU, and where torch cannot compile, for want of a C++ compiler or Python's headers."""
    if minutes < PAYS_AFTER_MINUTES or torch.cuda.is_available() or not _works():
        return function
    out: _Function = torch.compile(function, dynamic=False)  # type: ignore[assignment]
    return out


def _works() -> bool:
    try:
        torch.compile(torch.neg)(torch.ones(64))
    except Exception as error:  # whatever is missing, training goes on without
        # Of inductor's errors the first line only says that it is one.
        lines = [line for line in str(error).splitlines() if line.strip() and not line.endswith("raised:")]
        why = lines[0].strip() if lines else type(error).__name__
        print(f"training without torch.compile, an eighth slower: {why}", flush=True)
        return False
    return True
