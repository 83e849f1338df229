"""Changes in a JSON text that leave every other character of it as it was."""

import json
import re
from collections.abc import Iterator
from typing import Any

_SPACE = re.compile(r"[ \t\n\r]*")
_DECODER = json.JSONDecoder()


class JsonText:
    """A JSON document as text, with changes to make in it.

    Parts are named by the keys and numbers that lead to them, such as ("nodes", 3, "matrix").
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self._changes: list[tuple[int, int, str]] = []

    def has(self, *keys: str | int) -> bool:
        """Whether there is such a part."""
        return self._find(keys) is not None

    def append(self, key: str, items: list[Any]) -> None:
        """Add items at the end of the array of this name at the top, which is made where there is none."""
        listed = ",".join(_compact(item) for item in items)
        if not items:
            return
        found = self._find((key,))
        if found is None:
            start = self._space(0)
            end = self._last(start)
            comma = "," if next(self._members(start), None) is not None else ""
            self._changes.append((end, end, f'{comma}"{key}":[{listed}]'))
            return
        _, start, _ = found
        end = self._last(start)
        comma = "," if next(self._members(start), None) is not None else ""
        self._changes.append((end, end, comma + listed))

    def replace(self, value: Any, *keys: str | int) -> None:
        """Put another value in the place of a part that there is."""
        found = self._find(keys)
        assert found is not None
        self._changes.append((*found[1:], _compact(value)))

    def replace_member(self, members: dict[str, Any], *keys: str | int) -> None:
        """Put other members in the place of one member of an object, its name included."""
        found = self._find(keys)
        assert found is not None
        self._changes.append((found[0], found[2], _compact(members)[1:-1]))

    def changed(self) -> str:
        """The text with all changes made."""
        out = self.text
        for start, end, new in sorted(self._changes, reverse=True):
            out = out[:start] + new + out[end:]
        return out

    def _find(self, keys: tuple[str | int, ...]) -> tuple[int, int, int] | None:
        """Where a part's name, its value and what follows begin."""
        at, found = self._space(0), None
        for key in keys:
            found = next((m[1:] for m in self._members(at) if m[0] == key), None)
            if found is None:
                return None
            at = found[1]
        return found

    def _members(self, at: int) -> Iterator[tuple[str | int, int, int, int]]:
        """The members of an object or array: name or number, and where the name, the value and what follows begin."""
        keyed = self.text[at] == "{"
        at, number = self._space(at + 1), 0
        while self.text[at] not in "}]":
            name, key = at, number
            if keyed:
                key, at = _DECODER.raw_decode(self.text, at)
                at = self._space(self._space(at) + 1)
            end = _DECODER.raw_decode(self.text, at)[1]
            yield key, name, at, end
            at, number = self._space(end), number + 1
            if self.text[at] == ",":
                at = self._space(at + 1)

    def _last(self, at: int) -> int:
        """Where the last member of an object or array ends, or what could be its first would begin."""
        ends = [end for *_, end in self._members(at)]
        return ends[-1] if ends else at + 1

    def _space(self, at: int) -> int:
        found = _SPACE.match(self.text, at)
        assert found is not None
        return found.end()


def _compact(value: Any) -> str:
    return json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
