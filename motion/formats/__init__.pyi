from .registry import FORMATS as FORMATS
from .registry import Format as Format
from .registry import ReadOptions as ReadOptions
from .registry import can_use as can_use
from .registry import check_writable as check_writable
from .registry import read_file as read_file
from .registry import readable as readable
from .registry import writable as writable
from .registry import write_file as write_file

__all__ = [
    "FORMATS",
    "Format",
    "ReadOptions",
    "can_use",
    "check_writable",
    "read_file",
    "readable",
    "writable",
    "write_file",
]
