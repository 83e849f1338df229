"""Where the repository is, and where real recordings are, if there are any."""

from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
SHARED = REPOSITORY.parent / "shared"
DATA = SHARED / "data"
