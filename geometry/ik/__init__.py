"""Inverse kinematics: one interface to the classical methods for chains and trees, and an analytic limb."""

import lazy_loader as _lazy

__getattr__, __dir__, __all__ = _lazy.attach_stub(__name__, __file__)
