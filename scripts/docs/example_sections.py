"""A griffe extension: docstrings say `Example:` where there is one, and griffe knows the section as `Examples:`."""

import re
from typing import Any

from griffe import Extension, Object


class ExampleSections(Extension):
    """Renames the section, so that its doctest lines are shown as code."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Called for every object that was loaded."""
        if obj.docstring is not None:
            obj.docstring.value = re.sub(r"^(\s*)Example:$", r"\1Examples:", obj.docstring.value, flags=re.M)
