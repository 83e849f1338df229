"""Names and lists in messages."""

from collections.abc import Sequence


def readable(name: str) -> str:
    """``left_big_toe`` as ``left big toe``."""
    return name.replace("_", " ")


def join_words(items: Sequence[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + " and " + items[-1]
