"""The files of each person of a session of videos: points, motion, markers and report pages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any

from muybridge.arrays import FloatArray
from muybridge.geometry.landmarks.arrays import Points3D
from muybridge.geometry.landmarks.marker_sets import MarkerChoice
from muybridge.geometry.skeleton.motion import Motion
from muybridge.infer import report
from muybridge.infer.reconstruction.landmarks import Solution
from muybridge.infer.reconstruction.quality import Quality
from muybridge.infer.reconstruction.virtual_markers import marker_set
from muybridge.infer.report.data import PersonPage, ReportData
from muybridge.infer.results.names import (
    MARKERS_C3D,
    MOST_PEOPLE,
    MOTION_BVH,
    MOTION_GLB,
    POINTS_C3D,
    POINTS_TRC,
    REPORT,
    of_person,
)
from muybridge.infer.results.record import json_value
from muybridge.infer.results.run import Run
from muybridge.motion import contacts as foot_contacts
from muybridge.motion.formats.points.c3d import C3DTake

if TYPE_CHECKING:
    from muybridge.infer.viewer.data import Scene
    from muybridge.motion.contacts.find import Contacts


def written_people(solution: Solution) -> tuple[Solution, ...]:
    """Everyone who gets files: the person of interest, then the others."""
    return solution, *solution.others[: MOST_PEOPLE - 1]


def contacts_of(motion: Motion | None) -> Contacts | None:
    """The contacts of the feet where there is a motion."""
    return None if motion is None else foot_contacts.find_contacts(motion)


def with_contacts(points: Points3D, contacts: Contacts | None) -> C3DTake:
    """Points for a C3D, with contacts as events."""
    return C3DTake(points, events=() if contacts is None else foot_contacts.contact_events(contacts))


def write_people(run: Run, solution: Solution, markers: MarkerChoice) -> Contacts | None:
    """Write everyone's points, motion and markers of a set; returns the contacts of the person of interest."""
    people = written_people(solution)
    contacts = [contacts_of(person.motion) for person in people]
    for number, (person, standing) in enumerate(zip(people, contacts, strict=True), start=1):
        points: dict[str, Points3D | C3DTake] = {
            POINTS_TRC: person.points,
            POINTS_C3D: with_contacts(person.points, standing),
        }
        if person.markers is not None:
            points[MARKERS_C3D] = marker_set(person.markers, markers)
        run.write_points({of_person(name, number): each for name, each in points.items()})
        if person.motion is not None:
            run.write_motion([of_person(name, number) for name in (MOTION_BVH, MOTION_GLB)], person.motion)
    return contacts[0]


def write_reports(
    run: Run, title: str, solution: Solution, qualities: Sequence[Quality], shared: Mapping[str, Any],
    first: Mapping[str, Any], characters: Mapping[int, Scene] | None = None,
) -> tuple[str, ...]:  # fmt: skip
    """Write `report.html`, and one more page for each further person.

    Args:
        run: receives the files.
        title: of the first person's page.
        solution: the people.
        qualities: everyone's.
        shared: fields of `ReportData` that all pages have.
        first: fields that the first page alone has.
        characters: what everyone's motion was put onto, by the person's number.

    Returns:
        What spoils the first person's result, as sentences.
    """
    people = written_people(solution)
    names = [of_person(REPORT, n) for n in range(1, len(people) + 1)]
    pages = tuple(PersonPage(name, q.coverage, q.leave_one_out_px) for name, q in zip(names, qualities, strict=True))
    shared = {**shared, "pages": pages if len(pages) > 1 else (), "files": tuple(run.written)}
    serious: tuple[str, ...] = ()
    for n, (person, quality) in enumerate(zip(people, qualities, strict=True)):
        others = tuple(p.points.points_world for p in people if p is not person)
        own = {**(first if n == 0 else {}), "character": (characters or {}).get(n + 1)}
        data = _report_data(title, n + 1, person, others, quality, {**shared, **own})
        run.write(names[n], partial(report.write_report, data=data))
        serious = report.problems(data) if n == 0 else serious
    return serious


def _report_data(
    title: str, number: int, person: Solution, others: tuple[FloatArray, ...], quality: Quality,
    shared: Mapping[str, Any],
) -> ReportData:  # fmt: skip
    motion = person.motion
    tables = ("cameras", "landmarks")
    return ReportData(
        title=title if number == 1 else f"{title}, person {number}",
        points=person.measured,
        delivered=person.points,
        number=number,
        others=others,
        keypoints_px=person.points_px,
        leave_one_out_px=person.leave_one_out_px,
        joint_positions_world=None if motion is None else motion.joint_positions_world(),
        joint_names=() if motion is None else motion.skeleton.names,
        joint_parents=() if motion is None else tuple(motion.skeleton.parents),
        person=person.person,
        quality=json_value({k: v for k, v in asdict(quality).items() if k not in tables}),
        **shared,
    )
