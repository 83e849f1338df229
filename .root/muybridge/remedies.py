"""What a Python caller can do about an error, by the key that the exception carries.

The command line has a table with the same keys and commands to paste (`muybridge.infer.commands.remedies`); a test
compares the two. Texts are format strings; the exception's `details` fill in the names.
"""

REMEDIES: dict[str, str] = {
    "missing_weights": "reinstall muybridge, or pass the path of a model file",
    "other_name": "choose another name",
    "overwrite": "choose another name, or pass overwrite=True",
    "pseudo_labels": "make one with `muybridge.models.pseudo_labels.save_pseudo_labels`",
    "third_party_model": (
        "for a third-party keypoint network pass its model card; otherwise pass a model that muybridge exported, "
        "or none to use the shipped one"
    ),
    "unwritable": "choose a folder you may write to, or free its disk",
    "use_muybridge_model": "pass a model that muybridge exported, or none to use the shipped one",
}
