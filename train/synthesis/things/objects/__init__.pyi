from . import mobility as mobility

__all__ = ["mobility"]
