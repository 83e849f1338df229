"""Compilation of numerical kernels, with the same settings everywhere.

Numba is slow to load, and modules with kernels are loaded by commands that call none of them. So numba is loaded by the
first call of a kernel.
"""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Generic, ParamSpec, TypeVar

_P = ParamSpec("_P")
_R = TypeVar("_R")
_lock = threading.RLock()


class Kernel(Generic[_P, _R]):
    """A function that is compiled when it is first called, unless numba's cache has it."""

    def __init__(self, function: Callable[_P, _R], settings: Mapping[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self._function, self._settings = function, settings
        self._dispatcher: Any = None

    def __call__(self, *args: _P.args, **kwargs: _P.kwargs) -> _R:
        """Call the compiled function."""
        result: _R = (self._dispatcher or self.dispatcher)(*args, **kwargs)
        return result

    @property
    def dispatcher(self) -> Any:
        """What numba makes of the function."""
        with _lock:
            if self._dispatcher is None:
                _load_numba()
                from numba import njit

                self._dispatcher = njit(cache=True, **self._settings)(self._function)
            return self._dispatcher


def compiled(function: Callable[_P, _R]) -> Kernel[_P, _R]:
    """Compile a function that Python calls; kernels may call it too."""
    return Kernel(function, {"nogil": True, "error_model": "numpy"})


def compiled_with(**settings: Any) -> Callable[[Callable[_P, _R]], Kernel[_P, _R]]:
    """The same with other settings of `numba.njit`."""
    return lambda function: Kernel(function, settings)


# Functions that numba is told of once it is loaded, with the options of each; None when it is.
_waiting: list[tuple[Callable[..., Any], dict[str, Any]]] | None = []


def subroutine(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Make a function known to kernels, which are compiled with it.

    It gets no entry from Python and no file in the cache, which take half of the time that compiling takes. Python that
    calls it runs it as it stands.
    """
    return _known(function, {})


def leaf(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """The same for a function that makes no arrays: without code that counts references to them."""
    return _known(function, {"_nrt": False})


def sums(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """A `subroutine` of sums whose order does not matter: several products are added at a time. The result may differ
    in its last digits between processors."""
    return _known(function, {"fastmath": {"contract", "reassoc", "nsz"}})


def _known(function: Callable[_P, _R], options: dict[str, Any]) -> Callable[_P, _R]:
    with _lock:
        if _waiting is None:
            _register(function, options)
        else:
            _waiting.append((function, options))
    return function


def _register(function: Callable[..., Any], options: dict[str, Any]) -> None:
    from numba.extending import register_jitable

    register_jitable(error_model="numpy", no_cfunc_wrapper=True, **options)(function)


def _load_numba() -> None:
    """Tell numba what kernels are, once."""
    global _waiting
    if _waiting is None:
        return
    from numba import types
    from numba.extending import typeof_impl

    typeof_impl.register(Kernel)(lambda kernel, _: types.Dispatcher(kernel.dispatcher))
    for function, options in _waiting:
        _register(function, options)
    _waiting = None


def is_compiled(kernel: Any) -> bool:
    """Whether a kernel is in numba's cache, or cannot be: without a cache, compiling ahead is useless."""
    kernel = getattr(kernel, "dispatcher", kernel)
    folder = getattr(getattr(kernel, "stats", None), "cache_path", None)
    module = kernel.__module__.rpartition(".")[2]
    return folder is None or any(Path(folder).glob(f"{module}.{kernel.__name__}-*.nbi"))
