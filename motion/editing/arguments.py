"""Arguments of steps: what they are called, what they mean, and how words become their values."""

import difflib
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from muybridge.errors import MuybridgeError

# What a number is a number of: unit -> factor to metres, radians, seconds, Hz; "" is the unit without a word. Frames
# become seconds once the frame rate is known.
_FRAMES = "f"
KINDS: dict[str, dict[str, float]] = {
    "time": {"": 1.0, "s": 1.0, "ms": 1e-3, _FRAMES: 1.0},
    "length": {"": 1.0, "m": 1.0, "cm": 1e-2, "mm": 1e-3},
    "small length": {"": 1e-3, "mm": 1e-3, "cm": 1e-2, "m": 1.0},
    "angle": {"": math.pi / 180, "deg": math.pi / 180, "rad": 1.0},
    "frequency": {"": 1.0, "hz": 1.0},
    "frame rate": {"": 1.0, "fps": 1.0},
    "factor": {"": 1.0, "%": 0.01},
    "name": {},
}
_UNITS = {"time": "seconds", "length": "metres", "small length": "millimetres", "angle": "degrees", "frequency": "Hz",
          "frame rate": "frames per second", "factor": "a factor"}  # fmt: skip
_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)([a-z%]*)", re.I)
Value = float | str | None


@dataclass(frozen=True)
class Frames:
    """A time in frames, of a clip whose rate is not known yet."""

    count: float


@dataclass(frozen=True)
class Parameter:
    """One argument of a step.

    Attributes:
        name: of the function's argument, which `name=value` may say.
        kind: a key of KINDS.
        text: what it means, after its name.
        default: its value where it is left out, in the units of the function.
        required: whether it must be given.
        choices: the words that a name may be; empty: any.
    """

    name: str
    kind: str
    text: str
    default: Value = None
    required: bool = False
    choices: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """As help shows it: START, [END]."""
        shown = "|".join(self.choices) if 0 < len(self.choices) < 4 else self.name.upper()
        return shown if self.required else f"[{shown}]"

    def value(self, word: str) -> Value | Frames:
        """The value of a word.

        Raises:
            MuybridgeError: it is none; the message says what is.
        """
        if self.kind == "name":
            if self.choices and word not in self.choices:
                raise MuybridgeError(f"{self.name} is {_listed(self.choices)}, not {word!r}{meant(word, self.choices)}")
            return word
        units = KINDS[self.kind]
        found = _NUMBER.fullmatch(word)
        if found is None or found[2].lower() not in units:
            known = ", ".join(f"`{u}`" for u in units if u)
            raise MuybridgeError(
                f"{self.name} is a number in {_UNITS[self.kind]} ({known} may follow it), not {word!r}"
            )
        number = float(found[1])
        if not math.isfinite(number):
            raise MuybridgeError(f"{self.name} is too large: {word!r}")
        unit = found[2].lower()
        return Frames(number) if self.kind == "time" and unit == _FRAMES else number * units[unit]


def bind(parameters: Sequence[Parameter], words: Sequence[str]) -> dict[str, Value | Frames]:
    """Values by the name of the parameter.

    A word is the value of the next parameter that can have it, so that one may be left out before a word that is plain;
    `name=value` says which.

    Raises:
        MuybridgeError: too few or too many words, a name that is none, or a word that is no value.
    """
    out: dict[str, Value | Frames] = {}
    by_name = {p.name: p for p in parameters}
    for word in words:
        name, equals, text = word.partition("=")
        if not equals:
            parameter = _parameter_for(word, parameters, [p for p in parameters if p.name not in out])
            out[parameter.name] = parameter.value(word)
        elif name not in by_name:
            raise MuybridgeError(f"there is no {name!r} to set: {_takes(parameters)}{meant(name, by_name)}")
        elif name in out:
            raise MuybridgeError(f"{name} is given twice")
        else:
            out[name] = by_name[name].value(text)
    if missing := [p for p in parameters if p.required and p.name not in out]:
        raise MuybridgeError(f"{missing[0].name} is missing: {_takes(parameters)}")
    return {p.name: out.get(p.name, p.default) for p in parameters}


def _parameter_for(word: str, parameters: Sequence[Parameter], free: Sequence[Parameter]) -> Parameter:
    """Which of the parameters without a value a word is for."""
    for p in free:
        if word in p.choices:
            return p
    numeric = word[:1] in "+-.0123456789"
    fits = [p for p in free if (p.kind != "name") == numeric]
    if fits:
        return fits[0]
    if numeric or not free:
        raise MuybridgeError(f"{word!r} is one argument too many: {_takes(parameters)}")
    return free[0]


def resolved(values: dict[str, Value | Frames], fps: float) -> dict[str, Value]:
    """The values with frames in seconds."""
    return {name: value.count / fps if isinstance(value, Frames) else value for name, value in values.items()}


def _takes(parameters: Sequence[Parameter]) -> str:
    return f"it takes {' '.join(p.label for p in parameters)}" if parameters else "it takes no arguments"


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"


def meant(word: str, known: Iterable[str]) -> str:
    """The end of a message on a word that is none of those `known`: the nearest of them, if one is near."""
    near = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""
