"""Arguments of steps: what they are called, what they mean, and how words become their values."""

import difflib
import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from muybridge.errors import MuybridgeError
from muybridge.motion.take import Take

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
    "file": {},
    "times": {"": 1.0, "s": 1.0, "ms": 1e-3, _FRAMES: 1.0},  # two of them, OLD=NEW
}
_UNITS = {"time": "seconds", "times": "seconds", "length": "metres", "small length": "millimetres",
          "angle": "degrees", "frequency": "Hz", "frame rate": "frames per second", "factor": "a factor"}  # fmt: skip
_WORDS = ("name", "file")  # kinds of values that are no numbers
_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:e[-+]?\d+)?)([a-z%]*)", re.I)
Value = float | str | None | tuple[float, ...] | tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Frames:
    """A time in frames, of a clip whose rate is not known yet."""

    count: float


# What a word becomes: a value whose times may be in frames still.
Unresolved = Value | Frames | tuple["Unresolved", ...]


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
        many: whether it takes several words; its value is a tuple.
    """

    name: str
    kind: str
    text: str
    default: Value = None
    required: bool = False
    choices: tuple[str, ...] = ()
    many: bool = False

    @property
    def label(self) -> str:
        """As help shows it: START, [END], GAINS..."""
        shown = "|".join(self.choices) if 0 < len(self.choices) < 4 else self.name.upper()
        if self.kind == "times":
            shown = "OLD=NEW"
        return (shown if self.required else f"[{shown}]") + ("..." if self.many else "")

    def value(self, word: str) -> Unresolved:
        """The value of a word.

        Raises:
            MuybridgeError: it is none; the message says what is.
        """
        if self.kind == "name":
            if self.choices and word not in self.choices:
                raise MuybridgeError(f"{self.name} is {_listed(self.choices)}, not {word!r}{meant(word, self.choices)}")
            return word
        if self.kind == "file":
            return word
        if self.kind == "times":
            old, equals, new = word.partition("=")
            if not equals:
                raise MuybridgeError(f"{self.name} are two times, OLD=NEW, such as 1.0=0.8, not {word!r}")
            return self._number(old), self._number(new)
        return self._number(word)

    def _number(self, word: str) -> float | Frames:
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
        return Frames(number) if unit == _FRAMES else number * units[unit]


# From a take and the step's values to the edited take and a sentence on what was done.
Apply = Callable[..., tuple[Take, str]]


@dataclass(frozen=True)
class Step:
    """One kind of edit.

    Attributes:
        name: as users write it.
        text: what it does, in one line.
        apply: what does it.
        parameters: of the step, in the order in which they are written.
        points: whether points can be edited so too, not only a motion.
    """

    name: str
    text: str
    apply: Apply
    parameters: tuple[Parameter, ...] = ()
    points: bool = False

    @property
    def usage(self) -> str:
        """The step with its arguments, as help shows them."""
        return " ".join([self.name, *(p.label for p in self.parameters)])


def bind(parameters: Sequence[Parameter], words: Sequence[str]) -> dict[str, Unresolved]:
    """Values by the name of the parameter.

    A word is the value of the next parameter that can have it, so that one may be left out before a word that is plain;
    `name=value` says which.

    Raises:
        MuybridgeError: too few or too many words, a name that is none, or a word that is no value.
    """
    out: dict[str, Unresolved] = {}
    by_name = {p.name: p for p in parameters}
    several: dict[str, list[Unresolved]] = {}
    pairs = next((p for p in parameters if p.kind == "times"), None)
    for word in words:
        name, equals, text = word.partition("=")
        if pairs is not None and name not in by_name:
            parameter, text = pairs, word
        elif not equals:
            free = [p for p in parameters if p.name not in out]
            parameter, text = _parameter_for(word, parameters, free), word
        elif name not in by_name:
            raise MuybridgeError(f"there is no {name!r} to set: {_takes(parameters)}{meant(name, by_name)}")
        elif name in out:
            raise MuybridgeError(f"{name} is given twice")
        else:
            parameter = by_name[name]
        if parameter.many:
            several.setdefault(parameter.name, []).append(parameter.value(text))
        else:
            out[parameter.name] = parameter.value(text)
    out |= {name: tuple(values) for name, values in several.items()}
    if missing := [p for p in parameters if p.required and p.name not in out]:
        raise MuybridgeError(f"{missing[0].name} is missing: {_takes(parameters)}")
    return {p.name: out.get(p.name, p.default) for p in parameters}


def _parameter_for(word: str, parameters: Sequence[Parameter], free: Sequence[Parameter]) -> Parameter:
    """Which of the parameters without a value a word is for."""
    for p in free:
        if word in p.choices:
            return p
    if files := [p for p in free if p.kind == "file" and Path(word).suffix[1:2].isalpha()]:
        return files[0]
    numeric = word[:1] in "+-.0123456789"
    fits = [p for p in free if (p.kind not in _WORDS) == numeric]
    if fits:
        return fits[0]
    if numeric or not free:
        raise MuybridgeError(f"{word!r} is one argument too many: {_takes(parameters)}")
    return free[0]


def resolved(values: dict[str, Unresolved], fps: float) -> dict[str, Any]:
    """The values with frames in seconds."""

    def seconds(value: Unresolved) -> Any:
        if isinstance(value, tuple):
            return tuple(seconds(v) for v in value)
        return value.count / fps if isinstance(value, Frames) else value

    return {name: seconds(value) for name, value in values.items()}


def _takes(parameters: Sequence[Parameter]) -> str:
    return f"it takes {' '.join(p.label for p in parameters)}" if parameters else "it takes no arguments"


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"


def meant(word: str, known: Iterable[str]) -> str:
    """The end of a message on a word that is none of those `known`: the nearest of them, if one is near."""
    near = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {near[0]!r}?" if near else ""
