"""The command `character`: a mesh rigged, skinned and moved."""

import shlex
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import tyro

from muybridge.errors import FormatError, MuybridgeError
from muybridge.geometry.roles import RoleMap
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer.commands.remedies import print_error
from muybridge.infer.pipelines.characters.baking import bake_takes, check_baked
from muybridge.infer.pipelines.characters.pages import check_page, write_character_page
from muybridge.infer.pipelines.characters.retarget import measures, put_on, read_take
from muybridge.infer.pipelines.characters.rigging import (
    Rigged,
    bind_mesh,
    bound_target,
    check_character_output,
    rig_static,
    write_bound,
)
from muybridge.infer.pipelines.characters.takes import clip_names, find_takes
from muybridge.infer.results.ownership import bears_mark, check_replaceable, refuse_root
from muybridge.infer.runtime.each import try_each
from muybridge.infer.runtime.progress import Progress
from muybridge.motion.character.meshes.read import read_mesh
from muybridge.motion.character.meshes.static_mesh import StaticMesh
from muybridge.motion.character.meshes.write_usd import USD_SUFFIXES, texture_folder
from muybridge.motion.character.rigging.joints_file import write_joints as write_joints_file
from muybridge.motion.character.rigging.rig import RigOptions
from muybridge.motion.character.skinning import BakeOptions
from muybridge.motion.editing.resampling import check_resampled
from muybridge.motion.formats.points.common import check_fps
from muybridge.motion.retargeting.solver import RetargetOptions
from muybridge.wording import counted

COMMON_OPTIONS = {
    "character": ("motion", "out", "page", "template", "rig", "rig_only", "joints", "write_joints", "overwrite")
}
_TALLEST = 100.0  # metres; larger numbers are centimetres
_SHOWN = (".glb", ".vrm")  # formats that a page is made of as they are written


@dataclass(frozen=True)
class _Request:
    """What is written of a rigged mesh, and how."""

    out: Path
    page: Path | None
    clip_name: str | None
    fps: float | None
    plant: bool
    skinning: str


def character(
    mesh: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="MESH")],
    /,
    *,
    motion: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="TAKE...")] = (),
    out: Path | None = None,
    page: Path | None = None,
    template: Literal["human", "human-with-fingers", "biped", "quadruped"] = "human",
    rig: Literal["muybridge", "mixamo", "ue5", "vrm", "humanik"] = "muybridge",
    rig_only: bool = False,
    joints: Path | None = None,
    write_joints: Path | None = None,
    height: float | None = None,
    turn: bool = True,
    clip_name: str | None = None,
    take_map: Path | None = None,
    fps: float | None = None,
    plant: bool = True,
    skinning: Literal["linear", "spherical", "dual-quaternion", "rotation-centres", "delta-mush", "volume"] = "linear",
    overwrite: bool = False,
) -> int:
    """Put a skeleton into a mesh that has none, skin it, and move it by takes.

    The mesh stands, lies or faces anywhere, in an A-pose, a T-pose or with hanging arms; holes, loose parts and clothes
    are no obstacle. Materials, textures and texture coordinates are kept. A mesh that has a skin already goes to
    `muybridge retarget`.

    Examples:
        muybridge character hero.obj --motion walk.bvh --out hero.glb --page hero.html
        muybridge character hero.obj --rig-only --rig mixamo --write-joints joints.toml

    Args:
        mesh: .glb, .gltf, .vrm, .fbx, .obj, .ply or .stl.
        motion: files of motion, folders of them, session folders.
        out: file to write: .glb, .vrm, .fbx, .usdc, .usda or .usdz (default: MESH_rigged.glb in the current folder).
        page: write a web page as well in which the result is seen moving.
        template: skeleton to put in.
        rig: whose names the joints get.
        rig_only: write the rigged mesh in its rest pose, without motion.
        joints: TOML file with places of joints that are known (see `--write-joints`).
        write_joints: write such a file with what was found.
        height: metres that the body shall be tall (default: as the file has it).
        turn: stand a lying body up, and turn it to the front.
        clip_name: name of the clip (default: that of the take's file).
        take_map: TOML file that says which joint of the takes is which part of the body.
        fps: frames per second of the clips (default: the take's).
        plant: plant feet, and put soles on the floor.
        skinning: method that bends the mesh; others than linear are baked into a .glb or .vrm as morph targets.
        overwrite: replace files that are there.
    """
    _check_options(motion, out, page, rig_only, joints, write_joints, height)
    _check_clips(motion, clip_name, take_map, fps)
    out = out or Path(f"{mesh.stem}_rigged.glb")
    refuse_root(out)
    check_character_output(out)
    check_baked(out, skinning, len(motion))
    found_takes = find_takes(motion)
    takes = found_takes.files
    if takes and template == "quadruped":
        raise MuybridgeError(f"{takes[0]}: takes of people cannot be put onto a quadruped; give --rig-only")
    writes = [*([out] if takes or rig_only else []), *(path for path in (page, write_joints) if path is not None)]
    _check_outputs(writes, page, write_joints)
    inputs = [mesh, *takes, *(path for path in (joints, take_map) if path is not None)]
    check_replaceable(writes, overwrite, inputs, make_folders=False)
    body = _read(mesh, motion)
    if out in writes:
        _check_textures(out, body, overwrite, (mesh, *takes))
    # Before the joints are looked for, which takes longer: a take that cannot be read is known at once.
    tried = try_each(takes, partial(read_take, role_map=take_map), print_error)
    if takes and not tried.done:
        tried.report_failures("takes")
        return tried.exit_code
    with Progress() as progress:
        with progress.task(f"finding the joints of {mesh.name}", 1) as task:
            found = rig_static(body, RigOptions(template, rig, turn), joints, height)
            task.advance()
        for notice in (*found_takes.notices, *found.notices):
            progress.notice(notice)
        if write_joints is not None:
            write_joints_file(write_joints, mesh, found.rig)
        if takes or rig_only:
            _write(progress, found, tried.done, _Request(out, page, clip_name, fps, plant, skinning))
    print("\n".join(str(path) for path in writes))
    tried.report_failures("takes")
    return tried.exit_code


def _check_options(
    motion: Sequence[Path], out: Path | None, page: Path | None, rig_only: bool, joints: Path | None,
    write_joints: Path | None, height: float | None,
) -> None:  # fmt: skip
    """MuybridgeError for options that cannot be meant together."""
    if not motion and not rig_only and write_joints is None:
        raise MuybridgeError("no motion is named; give takes with --motion, or --rig-only for the rest pose")
    if motion and rig_only:
        raise MuybridgeError("--rig-only writes the rest pose, without the takes of --motion; leave out one of the two")
    for path in (out, page):
        if path is not None and not motion and not rig_only:
            raise MuybridgeError(f"{path} is written only with motion; give takes with --motion, or --rig-only")
    if height is not None and not 0.0 < height <= _TALLEST:
        raise MuybridgeError(f"--height is in metres, above 0 and at most {_TALLEST:g}, such as 1.8, not {height:g}")
    if height is not None and joints is not None:
        raise MuybridgeError("--height has no effect with --joints, whose places are metres of the size that the file "
                             "was written for; give --height together with --write-joints")  # fmt: skip


def _check_clips(motion: Sequence[Path], clip_name: str | None, take_map: Path | None, fps: float | None) -> None:
    """MuybridgeError for options of clips that cannot be, or of which there are none."""
    check_fps(fps)
    check_resampled(fps)
    if clip_name is not None and not clip_name.strip():
        raise MuybridgeError("--clip-name is empty; leave it out for the name of the take's file")
    named = {"clip-name": clip_name, "take-map": take_map, "fps": fps}
    for option, value in named.items():
        if value is not None and not motion:
            raise MuybridgeError(f"{option} applies to takes, and there are none", remedy="option_unused",
                                 option=option)  # fmt: skip


def _check_outputs(writes: Sequence[Path], page: Path | None, write_joints: Path | None) -> None:
    """MuybridgeError where two results would be one file, or a file is a folder."""
    if page is not None:
        check_page(page)
    places = [path.resolve() for path in writes]
    twice = next((path for k, path in enumerate(writes) if places[k] in places[:k]), None)
    if twice is not None:
        raise MuybridgeError(f"{twice}: is named for two results, which need files of their own",
                             remedy="other_name")  # fmt: skip
    if write_joints is not None and write_joints.is_dir():
        raise MuybridgeError(f"{write_joints}: is a folder; the joints need a file of their own", remedy="other_name")


def _read(mesh: Path, motion: Sequence[Path]) -> StaticMesh:
    """A mesh without a skeleton; where it has one already, the error names the command with the given takes."""
    try:
        return read_mesh(mesh)
    except FormatError as error:
        if error.remedy == "has_skin" and motion:
            error.details["takes"] = shlex.join(str(take) for take in motion)
        raise


def _check_textures(out: Path, body: StaticMesh, overwrite: bool, inputs: Sequence[Path]) -> None:
    """Refuse to write over a folder of textures beside a USD file; that of a file of ours is ours, too."""
    folder = texture_folder(out, body) if out.suffix.lower() in USD_SUFFIXES else None
    if folder is not None and not (out.is_file() and bears_mark(out)):
        check_replaceable([folder], overwrite, inputs, make_folders=False)


def _write(
    progress: Progress, found: Rigged, takes: Mapping[Path, tuple[Motion, RoleMap, list[str]]], request: _Request
) -> None:
    """Skin a rigged mesh, and write it at rest or moved."""
    out, vrm = request.out, request.out.suffix.lower() == ".vrm"
    with progress.task(f"skinning {found.mesh.path.name}", 1) as task:
        bound = bind_mesh(found, vrm)
        task.advance()
    target, placed = None, []
    with tempfile.TemporaryDirectory() as folder:
        if takes:
            target = bound_target(bound, found.rig, Path(folder) / f"rest{'.vrm' if vrm else '.glb'}")
            names = clip_names(list(takes), request.clip_name, ())
            options = RetargetOptions(plant=request.plant)
            with progress.task(f"{counted(len(takes), 'take')} on {found.mesh.path.name}", len(takes)) as task:
                for (path, take), name in zip(takes.items(), names, strict=True):
                    placed.append(put_on(path, take, target, name, options, request.fps))
                    task.advance()
        notices = write_bound(bound, out, target, placed)
        if target is not None and request.skinning != "linear":
            with progress.task(f"baking {request.skinning} skinning", 1) as task:
                notices.append(bake_takes(out, target, placed, request.skinning, BakeOptions()))
                task.advance()
        if request.page is not None:
            shown = out
            if out.suffix.lower() not in _SHOWN:
                shown = Path(folder) / "shown.glb"
                write_bound(bound, shown, target, placed)
            with progress.task(f"writing {request.page.name}", 1) as task:
                notices += write_character_page(request.page, shown, out, [one.name for one in placed])
                task.advance()
            if request.skinning != "linear":
                notices.append(
                    f"{request.page.name}: bends the mesh by linear blending; {out.name} has the other method"
                )
    for notice in dict.fromkeys([*(n for one in placed for n in one.notices), *notices]):
        progress.notice(notice)
    for one in placed:
        print(measures(one))
