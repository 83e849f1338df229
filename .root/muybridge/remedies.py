"""What a Python caller can do about an error, by the key that the exception carries.

The command line has a table with the same keys and commands to paste (`muybridge.infer.commands.remedies`); a test
compares the two. Texts are format strings; the exception's `details` fill in the names.
"""

REMEDIES: dict[str, str] = {
    "centres_of_landmarks": "leave centres empty",
    "model_of_card": "name its file as keypoint_model",
    "network_of_landmarks": "leave network out",
    "other_name": "choose another name",
    "overwrite": "choose another name, or pass overwrite=True",
    "rename_labels": "rename them, or name unlabelled points with muybridge.infer.pipelines.labelling.run_label",
    "unit_of_points": "read the file with units={unit!r}",
    "unwritable": "choose a folder you may write to, or free its disk",
}
