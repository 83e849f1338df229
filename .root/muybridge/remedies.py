"""What a Python caller can do about an error, by the key that the exception carries.

The command line has a table with the same keys and commands to paste (`muybridge.infer.commands.remedies`); a test
compares the two. Texts are format strings; the exception's `details` fill in the names.
"""

REMEDIES: dict[str, str] = {
    "align_rigid": 'pass align="rigid"',
    "board_page": "use smaller squares, larger paper, or paper=None for a page as large as the board needs",
    "butterworth": 'pass method="butterworth" with it',
    "bvh_units": "pass `units`, one of {units}",
    "calibration_path": "or pass the path of one",
    "centres_of_landmarks": "leave centres empty",
    "choose_clip": "pass `clip`, a name or a number of this list",
    "every_frame": "pass every=1",
    "export_fbx": "export it again as binary FBX",
    "export_gltf": "export it again as glTF 2.0",
    "fit_points": "fit a body to them first (fit_body)",
    "foreign_files": "move it, choose another folder, or pass overwrite=True",
    "fps_range": "pass a number above zero as fps, not {fps}",
    "fps_unstated": "pass `fps`, frames per second",
    "frames_unnumbered": "number them in a column `frame`, or pass `fps` if no frame is missing",
    "image_size": "pass size, videos or lenses",
    "leave_out_camera": "or leave the camera out",
    "lens_fisheye": 'if the lens is a fisheye lens, pass lens="fisheye"',
    "lens_pinhole": 'pass lens="pinhole", or keep the board away from the border of the image',
    "list_body_points": "muybridge.geometry.landmarks.marker_sets.SURFACE.names has all",
    "marker_dictionary": "or set marker_dictionary to the dictionary of the marker",
    "max_offset": "pass a larger max_offset",
    "missing_weights": "reinstall muybridge, or pass the path of a model file",
    "model_of_card": "name its file as keypoint_model",
    "move_folder": "move it, or choose another folder",
    "network_of_landmarks": "leave network out",
    "no_calibration": "or pass the path of one; muybridge.infer.pipelines.calibration makes one",
    "no_model_card": "leave model_card out",
    "npz_limit": "pass a larger `limit`, in bytes, if you trust the file",
    "option_unused": "leave out `{option}`",
    "other_folder": "choose another folder",
    "other_name": "choose another name",
    "other_session": "choose another folder, or pass overwrite=True",
    "overwrite": "choose another name, or pass overwrite=True",
    "plain_gltf": "export it again without compression",
    "points_off_shape": "add points well off the {shape}, or pass the camera with its lens in lenses",
    "points_or_lens": "add points, or pass the camera with its lens in lenses",
    "pseudo_labels": "make one with `muybridge.models.pseudo_labels.save_pseudo_labels`",
    "rename_labels": "rename them, learn what they mean with muybridge.infer.labelling.learn_set.learn_marker_set and "
    "pass the set as markerset, or name unlabelled points with muybridge.infer.pipelines.labelling.run_label",
    "resave_fbx": "open it in Blender 4.5 or newer, Maya or Autodesk's FBX Converter and export it as binary FBX",
    "role_map": "pass a map of roles; `muybridge.geometry.roles.suggest_role_map` makes one to start from",
    "session_results": "leave out `out` for the folder `muybridge` inside the session",
    "shift": "pass the time between them as shift",
    "still_moment": "name the image in which it does as moment",
    "sync_by_images": 'pass methods=("epipolar", "motion")',
    "third_party_model": (
        "for a third-party keypoint network pass its model card; otherwise pass a model that muybridge exported, "
        "or none to use the shipped one"
    ),
    "unit_of_points": "read the file with units={unit!r}",
    "unwritable": "choose a folder you may write to, or free its disk",
    "up_axis": "pass `up`, y or z",
    "use_muybridge_model": "pass a model that muybridge exported, or none to use the shipped one",
    "video_rotated": 'pass "rotate-cw" or "rotate-ccw", or calibrate with the camera as it records',
}
