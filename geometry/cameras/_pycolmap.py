"""pycolmap, without the handler that it installs for SIGTERM: that one prints a stack where a process is asked to end,
and can hang in it."""

import signal
import threading

_BEFORE = signal.getsignal(signal.SIGTERM)

import pycolmap  # noqa: E402

# Only the main thread may; None stands for a handler that was not installed from Python.
if threading.current_thread() is threading.main_thread() and _BEFORE is not None:
    signal.signal(signal.SIGTERM, _BEFORE)

__all__ = ["pycolmap"]
