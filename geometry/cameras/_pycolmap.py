"""pycolmap without its handler for SIGTERM, which prints a stack trace when a process is asked to end, and can hang."""

import signal
import threading

_BEFORE = signal.getsignal(signal.SIGTERM)

import pycolmap  # noqa: E402

# Only the main thread may set handlers; None stands for a handler that was not installed from Python.
if threading.current_thread() is threading.main_thread() and _BEFORE is not None:
    signal.signal(signal.SIGTERM, _BEFORE)

__all__ = ["pycolmap"]
