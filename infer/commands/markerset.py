"""The command `markerset`: lists, shows and learns marker sets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro

_What = tyro.conf.Positional[Literal["list", "points", "show", "from"]]


def markerset(
    what: Annotated[_What, tyro.conf.arg(metavar="list|points|show|from")],
    name: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="[NAME|TRIAL]")] = "",
    /,
    out: Path | None = None,
    model: Path | None = None,
    overwrite: bool = False,
) -> int:
    """List marker sets, show one, or learn one from a labelled trial.

    The action `list` names the sets; `points` names the points of the body where markers can be placed; `show NAME`
    prints a set as a text file that you can edit; `from TRIAL.c3d` learns a set from a labelled trial.

    Example:
        muybridge markerset show pig39 --out ours.txt

    Args:
        what: the action.
        name: marker set, or labelled trial.
        out: file that `show` and `from` write; without it, `show` prints the set.
        model: labelling network in place of the shipped one.
        overwrite: replace the file if it exists.
    """
    from muybridge.errors import MuybridgeError
    from muybridge.geometry.landmarks.marker_sets import SETS, SURFACE

    if what == "list":
        print("\n".join(f"{key:<8} {len(s)} markers: {' '.join(s.labels)}" for key, s in SETS.items()))
    elif what == "points":
        print("\n".join(SURFACE.names))
    elif not name:
        raise MuybridgeError(f"`markerset {what}` needs {'a set' if what == 'show' else 'a labelled trial'} after it")
    elif what == "show":
        _show(name, out, overwrite)
    else:
        _learn(Path(name), out, model, overwrite)
    return 0


def _show(name: str, out: Path | None, overwrite: bool) -> None:
    from muybridge.infer.results.ownership import check_replaceable
    from muybridge.motion.formats.points.marker_protocol import find_marker_set, marker_set_text, write_marker_set

    plan = find_marker_set(name)
    if out is None:
        print(marker_set_text(plan, name))
    else:
        check_replaceable([out], overwrite)
        write_marker_set(out, plan, name)
        print(f"wrote {out}")


def _learn(trial: Path, out: Path | None, model: Path | None, overwrite: bool) -> None:
    from muybridge.infer.labelling.learn_set import learn_marker_set
    from muybridge.infer.results.ownership import check_replaceable
    from muybridge.motion.formats.points.marker_protocol import write_marker_set

    path = out or Path(f"{trial.stem}.txt")
    check_replaceable([path], overwrite, [trial])
    plan, notes = learn_marker_set(trial, model)
    write_marker_set(path, plan, f"learned from {trial.name}; check it before you use it")
    print("\n".join([f"{len(plan.markers)} markers", *notes, f"wrote {path}; use it with --markerset {path}"]))
