"""What a user of the command line can type about an error, by the key that the exception carries.

The keys are those of `muybridge.remedies`. Texts are format strings; the exception's `details` fill in the names.
"""

from muybridge.errors import MuybridgeError

COMMAND_REMEDIES: dict[str, str] = {
    "other_name": "choose another name",
    "overwrite": "choose another name, or give --overwrite",
    "unwritable": "free its disk or choose another --out",
    "board_page": "take smaller squares (--square), larger paper or --paper fit",
    "calibration_path": "or name one with --calibration",
    "lens_fisheye": "if the lens is a fisheye lens, give --lens fisheye",
    "lens_pinhole": "give --lens pinhole, or keep the board away from the border of the image",
    "marker_dictionary": "or name its dictionary with --marker-dictionary",
    "points_off_shape": "add points well off the {shape}, or give the lens with --lenses",
    "points_or_lens": "add points, or give the lens with --lenses",
    "video_rotated": "give --video-size rotate-cw or rotate-ccw, or calibrate with the camera as it records",
}


def error_line(error: MuybridgeError) -> str:
    """The error's message and its remedy on the command line, in one line."""
    text = error.message
    if error.remedy is not None:
        text = f"{text}; {COMMAND_REMEDIES[error.remedy].format(**error.details)}"
    return " ".join(text.split())
