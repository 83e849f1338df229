"""Labelling of what laboratories record: markers beyond the set, turned heads, stated axes, pieces between gaps."""

import dataclasses
import json

import numpy as np
import pytest

pytest.importorskip("onnxruntime")

from muybridge.geometry.landmarks.marker_sets import SETS
from muybridge.infer.commands.app import run_command
from muybridge.infer.labelling.certainty import MOST, by_piece, certainty
from muybridge.infer.labelling.file_names import columns_of, with_names
from muybridge.infer.labelling.label import label_points
from muybridge.infer.networks.labelling import LabelNetwork
from muybridge.infer.pipelines.labelling import exchanged, stated_up
from muybridge.infer.report.labelling_facts import DOUBTFUL, doubtful
from muybridge.models.shipped import shipped_model
from muybridge.motion.formats.points.unlabelled import read_marker_cloud
from scripts.benchmarks.markers.label_trials import make_trial, recorded_person
from tests.paths import DATA

CASES = DATA / "cases"
SERVE = DATA / "markers" / "tennis_serve_pig39.c3d"
WALK = DATA / "markers" / "walk_force_plates.c3d"
LEG = ("THI", "KNE", "TIB", "ANK", "HEE", "TOE")
PIECES = CASES / "label_short_piece" / "first.c3d"
real = pytest.mark.skipif(not PIECES.is_file(), reason="no recordings beside this checkout")


@pytest.fixture(scope="module")
def network():
    return LabelNetwork(shipped_model("labels"))


@real
@pytest.mark.parametrize(("case", "asked"), [("label_head_turned/pf", "pig39"),
                                             ("label_extra_markers_up_axis/rbwh21_as_lower16", "lower16")])  # fmt: skip
def test_turned_heads_and_markers_beyond_the_set_do_not_exchange_names(network, case, asked):
    cloud, markers = read_marker_cloud(CASES / f"{case}.c3d"), SETS[asked]
    with np.load(CASES / f"{case}.npz") as true:
        names, truth = [str(n) for n in true["names"]], true["points_mm"] / 1000
    done = label_points(cloud.points, cloud.fps, markers, network)
    assert np.allclose(done.turn[2], [0, 0, 1])
    found = done.points[:, [markers.labels.index(n) for n in names]]
    seen = np.isfinite(truth[..., 0])
    assert (np.linalg.norm(found - truth, axis=-1) < 1e-3)[seen].mean() >= 0.97
    others = [i for i, n in enumerate(markers.labels) if n not in names]
    assert not np.isfinite(done.points[:, others, 0]).any()


def gaps_in(points, seed):
    """The same with gaps in a dozen columns that leave pieces of 2 to 60 frames."""
    rng, out = np.random.default_rng(seed), points.copy()
    for k in rng.permutation(points.shape[1])[:12]:
        at = 0
        while at < len(points):
            at += int(rng.integers(2, 60))
            gap = int(max(1, min(60, rng.lognormal(1.8, 1.2))))
            out[at : at + gap, k] = np.nan
            at += gap
    return out


def pieces_keep_names(network, seeds):
    cloud, markers = read_marker_cloud(PIECES), SETS["pig39"]
    own = np.array([[n.split(":")[-1] for n in cloud.names].index(label) for label in markers.labels])
    missed = total = 0
    for seed in seeds:
        points = gaps_in(cloud.points, seed)
        done = label_points(points, cloud.fps, markers, network)
        wrong = (done.column >= 0) & (done.column != own)
        listed = {(d["marker"], t) for d in doubtful(done) for t in range(d["frames"][0], d["frames"][1] + 1)}
        assert all((markers.labels[m], t) in listed for t, m in zip(*np.nonzero(wrong), strict=True)), seed
        there = np.isfinite(points[:, own, 0])
        missed, total = missed + int((there & (done.column != own)).sum()), total + int(there.sum())
    assert missed < 0.003 * total


@real
def test_t10_stays_t10_in_all_frames(network):
    cloud = read_marker_cloud(PIECES)
    done = label_points(cloud.points, cloud.fps, SETS["pig39"], network)
    names = [n.split(":")[-1] for n in cloud.names]
    column = done.column[:, SETS["pig39"].labels.index("T10")]
    there = np.isfinite(cloud.points[:, names.index("T10"), 0])
    assert (column[there] == names.index("T10")).all() and (column[~there] == -1).all()


@real
def test_pieces_between_gaps_keep_their_names_or_are_doubtful(network):
    pieces_keep_names(network, (3, 7))


@real
@pytest.mark.slow
def test_pieces_between_gaps_keep_their_names_in_many_patterns(network):
    pieces_keep_names(network, range(100))


@real
def test_what_a_file_states_as_up_is_believed(network):
    markers = SETS["pig39"]
    person = recorded_person(SERVE, markers)
    person = dataclasses.replace(person, points=person.points[300:360])
    for seed in range(1):
        trial = make_trial(person, np.random.default_rng(seed), plain=True)
        down = trial.cloud * [1, -1, -1]
        stated = np.array([0.0, 0.0, -1.0])
        done = label_points(down, trial.fps, markers, network, up=stated)
        assert np.allclose(done.turn @ stated, [0, 0, 1])
        assert np.nanmax(np.linalg.norm(done.points - trial.truth * [1, -1, -1], axis=-1)) < 1e-3
        # People say otherwise beyond doubt.
        done = label_points(down, trial.fps, markers, network, up=-stated)
        assert np.allclose(done.turn @ stated, [0, 0, 1])


@real
def test_names_that_a_file_has_exchanged_are_noted(network, tmp_path):
    cloud, markers = read_marker_cloud(PIECES), SETS["pig39"]
    names = list(cloud.names)
    a, b = names.index("LKNE"), names.index("LANK")
    names[a], names[b] = names[b], names[a]
    wrong = dataclasses.replace(cloud, names=tuple(names))
    done = label_points(cloud.points, cloud.fps, markers, network)
    assert exchanged(wrong, done) == [("LANK", "LKNE")] and exchanged(cloud, done) == []


@real
@pytest.mark.parametrize("asked", ["lower16", "pig39"])
def test_names_of_a_file_hold_where_a_marker_beyond_the_set_fits_better(network, asked):
    cloud, markers = read_marker_cloud(WALK), SETS[asked]
    done = label_points(cloud.points, cloud.fps, markers, network, up=stated_up(cloud), names=cloud.names)
    for m, label in enumerate(markers.labels):
        own = cloud.names.index(label) if label in cloud.names else -1
        assert set(done.column[:, m].tolist()) <= {own, -1}
        assert own < 0 or (done.column[np.isfinite(cloud.points[:, own, 0]), m] == own).all()
    # LTHI2 and RTHI2 stand where the set has LTHI and RTHI: these are not called certain.
    beside = [markers.labels.index("LTHI"), markers.labels.index("RTHI")]
    assert done.confidence[:, beside].max() < 0.95


@real
@pytest.mark.parametrize("pairs", [("LKNE LANK",), tuple(f"L{x} R{x}" for x in LEG)])
def test_names_that_a_file_has_exchanged_are_found_with_the_names_known(network, pairs):
    cloud, markers = read_marker_cloud(PIECES), SETS["pig39"]
    names, moved = [n.split(":")[-1] for n in cloud.names], {}
    for a, b in (pair.split() for pair in pairs):
        moved |= {a: b, b: a}
    wrong = [moved.get(n, n) for n in names]
    done = label_points(cloud.points, cloud.fps, markers, network, names=wrong)
    usual = [int(np.bincount(c[c >= 0]).argmax()) for c in done.column.T]
    assert usual == [names.index(label) for label in markers.labels]


def test_columns_by_name_ignore_prefixes_and_case_and_leave_out_names_given_twice():
    names = ("Bob:LASI", "bob:rasi", "LPSI", "LPSI", "LTHI2", "*7")
    hint = columns_of(names, SETS["lower16"])
    assert hint[:2].tolist() == [0, 1] and 2 not in hint and 3 not in hint and 5 not in hint


@real
def test_the_vertical_axis_is_taken_from_the_file_and_every_unsure_name_is_listed(tmp_path, capsys):
    assert np.array_equal(stated_up(read_marker_cloud(WALK)), [0, 0, 1])
    assert stated_up(read_marker_cloud(PIECES)) is None
    assert run_command(["label", str(PIECES), "--out", str(tmp_path / "o")]) == 0
    content = json.loads((tmp_path / "o" / "label.json").read_text())
    listed = {(d["marker"], t) for d in content["doubtful"] for t in range(d["frames"][0], d["frames"][1] + 1)}
    for name, marker in content["markers"].items():
        named = {t for first, last, _ in marker["from"] for t in range(first, last + 1)}
        assert {t for t in named if marker["confidence"][t] < DOUBTFUL - 0.005} <= {t for n, t in listed if n == name}


def test_certainty_is_a_probability_that_grows_with_the_margin():
    poor, good = np.zeros((1, 1, 13)), np.zeros((1, 1, 13))
    good[..., :4], poor[..., -1], good[..., -1] = [8.0, 2.2, 8.0, 2.2], 1, 1
    assert 0 < certainty(poor)[0, 0] < certainty(good)[0, 0] <= MOST


def test_a_piece_whose_own_distances_do_not_fit_is_not_sure():
    column = np.array([3] * 10 + [-1] * 5 + [3] * 4 + [7] * 6)[:, None]
    fit = np.array([0.8] * 10 + [0.0] * 5 + [-0.2] * 4 + [0.6] * 6)[:, None]
    sure = by_piece(np.full((25, 1), 0.95), fit, column)[:, 0]
    assert (sure[:10] == 0.95).all() and (sure[15:19] <= 0.5).all() and (sure[19:] == 0.95).all()


def test_certainty_grows_with_a_name_of_the_file_and_falls_where_it_says_otherwise():
    hint, kept = np.array([4, 5, -1]), np.array([True, False, False])
    own = np.full((1, 3), 0.9)
    sure = with_names(own, np.array([[4, 6, 7]]), hint, kept)[0]
    assert 0.9 < sure[0] <= MOST and sure[1] < 0.9 and sure[2] == 0.9
    assert np.array_equal(with_names(own, np.array([[4, 6, 7]]), hint, np.zeros(3, bool)), own)
