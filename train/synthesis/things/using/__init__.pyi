from . import sitting as sitting

__all__ = ["sitting"]
