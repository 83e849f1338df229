"""Words in messages that depend on numbers."""


def counted(count: int, noun: str) -> str:
    """``1 frame``, ``2 frames``: a count and a noun whose plural ends in s."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
