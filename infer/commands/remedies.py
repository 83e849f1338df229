"""What a user of the command line can type about an error, by the key that the exception carries.

The keys are those of `muybridge.remedies`. Texts are format strings; the exception's `details` fill in the names.
"""

from muybridge.errors import MuybridgeError

COMMAND_REMEDIES: dict[str, str] = {
    "centres_of_landmarks": "leave out --centres",
    "model_of_card": "name its file with --keypoint-model",
    "network_of_landmarks": "leave out --network",
    "other_name": "choose another name",
    "overwrite": "choose another name, or give --overwrite",
    "rename_labels": "rename them, or name unlabelled points with `muybridge label`",
    "unit_of_points": "give --units {unit}",
    "unwritable": "free its disk or choose another --out",
}


def error_line(error: MuybridgeError) -> str:
    """The error's message and its remedy on the command line, in one line."""
    text = error.message
    if error.remedy is not None:
        text = f"{text}; {COMMAND_REMEDIES[error.remedy].format(**error.details)}"
    return " ".join(text.split())
