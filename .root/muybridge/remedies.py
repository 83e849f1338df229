"""What a Python caller can do about an error, by the key that the exception carries.

The command line has a table with the same keys and commands to paste (`muybridge.infer.commands.remedies`); a test
compares the two. Texts are format strings; the exception's `details` fill in the names.
"""

REMEDIES: dict[str, str] = {
    "other_name": "choose another name",
    "overwrite": "choose another name, or pass overwrite=True",
    "unwritable": "choose a folder you may write to, or free its disk",
    "board_page": "use smaller squares, larger paper, or paper=None for a page as large as the board needs",
    "calibration_path": "or pass the path of one",
    "lens_fisheye": 'if the lens is a fisheye lens, pass lens="fisheye"',
    "lens_pinhole": 'pass lens="pinhole", or keep the board away from the border of the image',
    "marker_dictionary": "or set marker_dictionary to the dictionary of the marker",
    "points_off_shape": "add points well off the {shape}, or pass the camera with its lens in lenses",
    "points_or_lens": "add points, or pass the camera with its lens in lenses",
    "video_rotated": 'pass "rotate-cw" or "rotate-ccw", or calibrate with the camera as it records',
}
