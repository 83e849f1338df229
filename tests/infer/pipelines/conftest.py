"""What the tests of pipelines share."""

from collections.abc import Callable
from pathlib import Path

import pytest


@pytest.fixture
def take(make_session: Callable[..., Path]) -> Path:
    """A session of 30 frames in three cameras."""
    return make_session(frames=30, width=160, height=120)
