from .digests import code_digest as code_digest
from .digests import digest as digest
from .digests import file_digest as file_digest
from .digests import sampled_digest as sampled_digest
from .progress import Progress as Progress
from .progress import Task as Task
from .stages import StageResult as StageResult
from .stages import Stages as Stages
from .stages import StageStore as StageStore

__all__ = [
    "Progress",
    "StageResult",
    "StageStore",
    "Stages",
    "Task",
    "code_digest",
    "digest",
    "file_digest",
    "sampled_digest",
]
