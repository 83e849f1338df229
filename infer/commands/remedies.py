"""What a user of the command line can type about an error, by the key that the exception carries.

The keys are those of `muybridge.remedies`. Texts are format strings; the exception's `details` fill in the names.
"""

import sys

from muybridge.errors import MuybridgeError

COMMAND_REMEDIES: dict[str, str] = {
    "align_rigid": "give --align rigid",
    "board_page": "take smaller squares (--square), larger paper or --paper fit",
    "build_graph": "`muybridge graph build TAKES --out walks.graph` makes one",
    "butterworth": "give --smooth butterworth with it",
    "bvh_units": "state it with --units, one of {units}",
    "calibration_path": "or name one with --calibration",
    "centres_of_landmarks": "leave out --centres",
    "character_extra": "install it with `pip install 'muybridge[character]'`",
    "choose_clip": "choose one of this list with --clip",
    "compile_mjcf": "save the compiled model with MuJoCo (mj_saveLastXML), which resolves it",
    "every_frame": "give --every 1",
    "expand_xacro": "expand them with ROS, `xacro {xacro} > {urdf}`, and name the result",
    "export_fbx": "export it again as binary FBX",
    "export_gltf": "export it again as glTF 2.0",
    "fit_points": "fit a body to them with `muybridge solve POINTS --out FOLDER`, which writes it",
    "foreign_files": "move it, choose another --out, or give --overwrite",
    "fps_range": "give --fps a number above zero, not --fps {fps}",
    "fps_unstated": "state it with --fps",
    "frames_unnumbered": "number them in a column `frame`, or state with --fps that nothing is missing",
    "graph_threshold": "give --threshold {metres}, or add takes that are alike somewhere",
    "has_skin": "put takes onto it with `muybridge retarget {takes} --to {mesh}`",
    "image_size": "give --size WIDTH HEIGHT, --videos or --lenses",
    "learn_style": "`muybridge style TAKES --out mine.style` makes one",
    "leave_out_camera": "or leave it out with --cameras",
    "lens_fisheye": "if the lens is a fisheye lens, give --lens fisheye",
    "lens_pinhole": "give --lens pinhole, or keep the board away from the border of the image",
    "list_body_points": "`muybridge markerset points` lists all",
    "marker_dictionary": "or name its dictionary with --marker-dictionary",
    "max_offset": "give a larger --max-offset",
    "mesh_faces": "export it with its faces",
    "mesh_repair": "clean it up in the program that made it and export it again",
    "missing_weights": "reinstall muybridge, or name a model file of yours",
    "model_of_card": "name its file with --keypoint-model",
    "move_folder": "move it, or choose another --out",
    "network_of_landmarks": "leave out --network",
    "no_calibration": (
        "or name one with --calibration; to make one, record a board that `muybridge calibrate print-board board.pdf "
        "--columns 7 --rows 5 --square 0.035` prints, and run `muybridge calibrate board RECORDINGS --columns 7 "
        "--rows 5 --square 0.035 --out {session}/calibration.toml`, or measure points and run `muybridge calibrate "
        "points POINTS.csv --videos {session}/videos --out {session}/calibration.toml`"
    ),
    "no_human_body": "it can be viewed and converted, and edited with all steps but `plant` and `rename`",
    "no_model_card": "leave out --model-card",
    "npz_limit": "save what is needed of it in smaller files, or read it in Python with a larger `limit`",
    "option_unused": "leave out --{option}",
    "other_folder": "choose another folder with --out",
    "other_name": "choose another name",
    "other_session": "choose another --out, or give --overwrite",
    "other_skeleton": "put it onto the same skeleton first: `muybridge retarget TAKE --to CHARACTER --out OUT`",
    "other_style": "learn one with this file first: `muybridge style FILE TAKES --out mine.style`",
    "overwrite": "choose another name, or give --overwrite",
    "plain_gltf": "export it again without compression",
    "points_off_shape": "add points well off the {shape}, or give the lens with --lenses",
    "points_or_lens": "add points, or give the lens with --lenses",
    "pseudo_labels": "`muybridge adapt SESSION` makes one",
    "rename_labels": "rename them, learn what they mean with `muybridge markerset from {path} --out set.txt` and solve "
    "with --markerset set.txt, or name unlabelled points with `muybridge label`",
    "resave_fbx": "open it in Blender 4.5 or newer, Maya or Autodesk's FBX Converter and export it as binary FBX",
    "rig_quadruped": "give --template quadruped",
    "rig_template": "give another --template, or the places of the joints with --joints",
    "role_map": "name its joints in a file with --map; `muybridge retarget --suggest` writes one to start from",
    "run_session": "`muybridge run {path}` makes it",
    "scale_robot": "scale the file",
    "session_results": "leave out --out to get the folder `muybridge` inside the session",
    "shift": "give the time between them with --shift",
    "split_joint": "replace the joint by several hinges, one an axis",
    "still_moment": "name the image in which it does with --moment",
    "sync_by_images": "give --methods epipolar motion",
    "take_map": "name its joints in a file with --take-map; `muybridge retarget --to TAKE --suggest` writes one to "
    "start from",
    "third_party_model": (
        "for a third-party keypoint network name its card with --model-card; otherwise name a model that muybridge "
        "exported, or leave the option out to use the shipped one"
    ),
    "unit_of_points": "give --units {unit}",
    "unwritable": "free its disk or choose another --out",
    "up_axis": "give --up y or --up z",
    "usd_extra": "install it with `pip install 'muybridge[usd]'`",
    "use_muybridge_model": "name a model that muybridge exported, or leave the option out to use the shipped one",
    "video_rotated": "give --video-size rotate-cw or rotate-ccw, or calibrate with the camera as it records",
}


def print_error(error: MuybridgeError) -> None:
    """Print an error in one line to stderr."""
    print(f"error: {error_line(error)}", file=sys.stderr, flush=True)


def error_line(error: MuybridgeError) -> str:
    """The error's message and its remedy on the command line, in one line."""
    text = error.message
    if error.remedy is not None:
        text = f"{text}; {COMMAND_REMEDIES[error.remedy].format(**error.details)}"
    return " ".join(text.split())
