"""Training precision: bfloat16 where the machine multiplies in it natively, else float32.

A processor without bfloat16 instructions (AVX2 alone, as in most laptops) emulates it: the forward and backward pass of
a convolution takes eight to eleven times as long as in float32. With them it takes an eighth to a half as long.
"""

import time
from functools import lru_cache

import torch
from torch import Tensor, nn

# How many times faster bfloat16 has to be, since it rounds.
_LEAST_GAIN = 1.2
_ROUNDS = 3
_fixed: bool | None = None


@torch.compiler.assume_constant_result  # type: ignore[untyped-decorator]
def bfloat16_is_faster(kind: str) -> bool:
    """Whether training in bfloat16 is faster than in float32 on a device of this kind ("cpu", "cuda").

    On a CPU it is measured with a convolution, once per process, which takes 0.1 to 1 s: a processor's feature flags
    tell neither how fast it is nor what torch makes of them.
    """
    if kind != "cpu":
        return True
    return _measure() if _fixed is None else _fixed


def fix_precision(bfloat16: bool) -> None:
    """Use this precision on the CPU instead of measuring, as a process does that works for another one."""
    global _fixed
    _fixed = bfloat16


def autocast(device: torch.device) -> torch.autocast:
    """The context in which a network is trained on `device`."""
    return torch.autocast(device.type, dtype=torch.bfloat16, enabled=bfloat16_is_faster(device.type))


def name(device: torch.device) -> str:
    """Name of the training precision on `device`: "bfloat16" or "float32"."""
    return "bfloat16" if bfloat16_is_faster(device.type) else "float32"


@lru_cache(maxsize=1)
def _measure() -> bool:
    with torch.random.fork_rng(devices=[]):
        layer = nn.Conv2d(64, 64, 3, padding=1)
        image = torch.randn(2, 64, 48, 48).contiguous(memory_format=torch.channels_last)
    # Alternating, so that other load slows both; the first round of each is a warm-up.
    rounds = [[_seconds(layer, image, bfloat16) for bfloat16 in (False, True)] for _ in range(_ROUNDS + 1)][1:]
    float32_s, bfloat16_s = (min(each) for each in zip(*rounds, strict=True))
    return bool(float32_s > _LEAST_GAIN * bfloat16_s)


def _seconds(layer: nn.Module, image: Tensor, bfloat16: bool) -> float:
    """Duration of the layer's forward and backward pass."""
    start = time.perf_counter()
    with torch.enable_grad():
        image = image.detach().requires_grad_()
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=bfloat16):
            out = layer(image)
        torch.autograd.grad(out.float().sum(), [image, *layer.parameters()])
    return time.perf_counter() - start
