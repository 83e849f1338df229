from .feet import FEET as FEET

__all__ = ["FEET"]
