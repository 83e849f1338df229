"""What a Python caller can do about an error, by the key that the exception carries.

The command line has a table with the same keys and commands to paste (`muybridge.infer.commands.remedies`); a test
compares the two. Texts are format strings; the exception's `details` fill in the names.
"""

REMEDIES: dict[str, str] = {
    "model-missing-from-installation": "reinstall muybridge, or pass the path of a model file",
    "pseudo-labels": "make one with `muybridge.models.pseudo_labels.save_pseudo_labels`",
    "third-party-model": (
        "for a third-party keypoint network pass its model card; otherwise pass a model that muybridge exported, "
        "or none to use the shipped one"
    ),
    "use-muybridge-model": "pass a model that muybridge exported, or none to use the shipped one",
}
