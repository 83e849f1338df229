"""What a Python caller can do about an error, by the key that the exception carries.

The command line has a table with the same keys and commands to paste (`muybridge.infer.commands.remedies`); a test
compares the two. Texts are format strings; the exception's `details` fill in the names.
"""

REMEDIES: dict[str, str] = {
    "other_name": "choose another name",
    "overwrite": "choose another name, or pass overwrite=True",
    "unwritable": "choose a folder you may write to, or free its disk",
}
