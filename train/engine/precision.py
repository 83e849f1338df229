"""In which precision a network is trained: bfloat16 where the machine multiplies in it, else float32.

A processor without instructions for bfloat16 (AVX2 alone, as most laptops have) works it out in pieces: a convolution,
forth and back, takes eight to eleven times as long as in float32. Where it has them, it takes a half to an eighth.
"""

import time
from functools import lru_cache

import torch
from torch import Tensor, nn

# By how much bfloat16 has to be faster, since it rounds.
_PAYS = 1.2
_ROUNDS = 3
_settled: bool | None = None


@torch.compiler.assume_constant_result  # type: ignore[untyped-decorator]
def pays(kind: str) -> bool:
    """Whether training in bfloat16 is faster than in float32 on a device of this kind ("cpu", "cuda").

    On a CPU it is measured, once a process, by a convolution, which takes 0.1 to 1 s: what a processor says that it
    has does not tell how fast it is, nor what torch makes of it.
    """
    if kind != "cpu":
        return True
    return _measured() if _settled is None else _settled


def settle(rough: bool) -> None:
    """Has this process do on a CPU as the one does that it works for, instead of measuring for itself."""
    global _settled
    _settled = rough


def autocast(device: torch.device) -> torch.autocast:
    """The context in which a network is trained on `device`."""
    return torch.autocast(device.type, dtype=torch.bfloat16, enabled=pays(device.type))


def name(device: torch.device) -> str:
    """Of the precision in which a network is trained on `device`: "bfloat16" or "float32"."""
    return "bfloat16" if pays(device.type) else "float32"


@lru_cache(maxsize=1)
def _measured() -> bool:
    with torch.random.fork_rng(devices=[]):
        layer = nn.Conv2d(64, 64, 3, padding=1)
        image = torch.randn(2, 64, 48, 48).contiguous(memory_format=torch.channels_last)
    # In turns, so that what else the machine does slows both; the first of each sets up.
    rounds = [[_seconds(layer, image, rough) for rough in (False, True)] for _ in range(_ROUNDS + 1)][1:]
    precise, rough = (min(each) for each in zip(*rounds, strict=True))
    return bool(precise > _PAYS * rough)


def _seconds(layer: nn.Module, image: Tensor, rough: bool) -> float:
    """Of the layer forth and back."""
    start = time.perf_counter()
    with torch.enable_grad():
        image = image.detach().requires_grad_()
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=rough):
            out = layer(image)
        torch.autograd.grad(out.float().sum(), [image, *layer.parameters()])
    return time.perf_counter() - start
