"""Inverse kinematics of chains and trees of hinges: all classical methods behind one interface."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
