"""Editing of motion and points: functions from one to another, and the table of steps of the command `edit`."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
