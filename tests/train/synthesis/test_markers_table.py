"""Virtual markers are at anatomical positions on every body, and project where they are drawn."""

import numpy as np
import pytest

from muybridge.geometry.landmarks.arrays import Points3D, select_markers
from muybridge.geometry.landmarks.marker_sets import CMU, PLUG_IN_GAIT, SURFACE
from muybridge.motion.formats.points.c3d import read_c3d, write_c3d
from tests.paths import SHARED

DATA = SHARED / "data/markers/tennis_serve_pig39.c3d"
CMU_LABELS = """LFHD RFHD LBHD RBHD C7 T10 CLAV STRN RBAC LSHO LUPA LELB LFRM LWRA LWRB LFIN RSHO RUPA RELB RFRM RWRA
RWRB RFIN LFWT RFWT LBWT RBWT LTHI LKNE LSHN LANK LHEE LTOE LMT5 RTHI RKNE RSHN RANK RHEE RTOE RMT5""".split()
# What the skin of adults measures, metres: anthropometry's 1st to 99th percentile and the skin's thickness.
WIDTHS = {
    ("left_asis", "right_asis"): (0.19, 0.32), ("left_psis", "right_psis"): (0.06, 0.14),
    ("left_knee_lateral", "left_knee_medial"): (0.08, 0.15), ("left_elbow_lateral", "left_elbow_medial"): (0.05, 0.10),
    ("left_malleolus_lateral", "left_malleolus_medial"): (0.055, 0.09),
    ("left_radial_styloid", "left_ulnar_styloid"): (0.04, 0.075), ("c7", "t10"): (0.19, 0.32),
    ("sternal_notch", "xiphoid"): (0.14, 0.27), ("left_acromion", "right_acromion"): (0.27, 0.46),
    ("left_metatarsal_1", "left_metatarsal_5"): (0.07, 0.12), ("left_heel", "left_toe"): (0.15, 0.26),
    ("left_knee_lateral", "left_malleolus_lateral"): (0.33, 0.55), ("left_asis", "left_psis"): (0.13, 0.30),
}  # fmt: skip


@pytest.fixture(scope="module")
def body():
    pytest.importorskip("torch")
    pytest.importorskip("anny")
    from muybridge.train.synthesis.bodies.body_model import BodyModel

    return BodyModel(5)


@pytest.fixture(scope="module")
def adults(body):
    """Vertices (24, V, 3) of adults in the A-pose."""
    body.rng = body.poses.rng = np.random.default_rng(4)
    phenotypes = body.sample_phenotypes(64)
    adult = phenotypes[:, list(body.model.phenotype_labels).index("age")] > 0.62
    return body.forward(np.zeros((24, len(body.bones), 3)), phenotypes[adult][:24])[0]


def test_sets_contain_every_marker_once():
    assert len(PLUG_IN_GAIT) == len(set(PLUG_IN_GAIT.labels)) == len(set(PLUG_IN_GAIT.names)) == 39
    assert len(CMU) == len(set(CMU.names)) == 41 and sorted(CMU.labels) == sorted(CMU_LABELS)
    assert len(set(SURFACE.names)) == len(SURFACE) == 72
    assert set(PLUG_IN_GAIT.names) | set(CMU.names) <= set(SURFACE.names)
    for joint in ("elbow", "knee", "malleolus"):
        assert sum(joint in n for n in SURFACE.names) == 4  # medial and lateral, left and right
    assert PLUG_IN_GAIT.names[PLUG_IN_GAIT.labels.index("LASI")] == "left_asis"


def test_a_real_plug_in_gait_file_has_the_same_labels():
    if not DATA.exists():
        pytest.skip(f"no {DATA.name}")
    labels = [n.split(":")[-1] for n in read_c3d(DATA).landmarks.names]
    assert sorted(labels) == sorted(PLUG_IN_GAIT.labels)


def test_mirrors_are_mutual():
    for markers in (SURFACE, PLUG_IN_GAIT, CMU):
        twin = np.array(markers.mirror)
        assert (twin[twin] == np.arange(len(markers))).all()
    labels = PLUG_IN_GAIT.labels
    assert labels[PLUG_IN_GAIT.mirror[labels.index("LUPA")]] == "RUPA"
    assert PLUG_IN_GAIT.mirror[labels.index("RBAK")] == labels.index("RBAK")


def test_table_has_the_order_of_the_network(body):
    import csv

    from muybridge.train.synthesis.bodies.surface_markers import TABLE, marker_table

    rows = list(csv.DictReader(TABLE.open(newline="")))
    assert tuple(r["name"] for r in rows) == SURFACE.names
    assert tuple(r["mirror"] for r in rows) == tuple(SURFACE.names[i] for i in SURFACE.mirror)
    for markers, column in ((PLUG_IN_GAIT, "pig39"), (CMU, "cmu41")):
        assert {r[column]: r["name"] for r in rows if r[column]} == dict(
            zip(markers.labels, markers.names, strict=True)
        )
    table = marker_table()
    np.testing.assert_allclose(table.weights.sum(1), 1, atol=1e-6)
    assert (table.weights > -1e-6).all()
    assert ((table.tolerance_m >= 0.004) & (table.tolerance_m <= 0.03)).all()


def test_markers_are_symmetric_and_on_the_skin(body, adults):
    from scipy.spatial import cKDTree

    from muybridge.train.synthesis.bodies.body_model import BODY_VERTICES
    from muybridge.train.synthesis.bodies.surface_markers import marker_table, virtual_markers

    points = virtual_markers(adults)
    mirrored = points[:, list(SURFACE.mirror)] * [-1, 1, 1]
    # No more than the mesh itself, whose neck stands up to 1 mm aside.
    rest = body.rest[:BODY_VERTICES]
    twin = cKDTree(rest).query(rest * [-1, 1, 1])[1]
    skin = adults[:, :BODY_VERTICES]
    aside = np.linalg.norm(skin - skin[:, twin] * [-1, 1, 1], axis=2)
    assert aside.max() < 0.002
    own = aside[:, marker_table().vertices].max(2)
    assert (np.linalg.norm(points - mirrored, axis=2) < own + 1e-4).all()
    faces = {tuple(sorted(map(int, f))) for f in body.parts[0]}
    on_faces = [tuple(sorted(map(int, t))) in faces for t in marker_table().vertices]
    left_and_middle = [not n.startswith("right_") for n in SURFACE.names]
    assert all(np.array(on_faces)[left_and_middle])
    # Mirrored triangles may cut a quadrilateral along its other diagonal: still on the skin within 2 mm.
    for vertices, markers in zip(adults[:4], points[:4], strict=True):
        t = vertices[body.parts[0]][:, None]
        w = np.array([(i, j, 6 - i - j) for i in range(7) for j in range(7 - i)], np.float32) / 6
        corners = t[:, 0]
        near = cKDTree(vertices[:BODY_VERTICES]).query(markers, 6)[1]
        for m, around in zip(markers, near, strict=True):
            use = np.isin(body.parts[0], around).any(1)
            dense = np.einsum("sk,fkc->fsc", w, corners[use]).reshape(-1, 3)
            edge = np.linalg.norm(np.ptp(corners[use], axis=1), axis=1).max() / 6
            assert np.linalg.norm(dense - m, axis=1).min() < 0.002 + edge / 2


def test_distances_match_anthropometry(adults):
    from muybridge.train.synthesis.bodies.surface_markers import virtual_markers

    at = dict(zip(SURFACE.names, virtual_markers(adults).transpose(1, 0, 2), strict=True))
    for (a, b), (low, high) in WIDTHS.items():
        width = np.linalg.norm(at[a] - at[b], axis=1)
        assert (width > low).mean() > 0.9 and (width < high).mean() > 0.9, (a, b, width.min(), width.max())
    assert (at["left_asis"][:, 1] < at["left_psis"][:, 1] - 0.1).all()  # the front is -y
    assert (at["left_knee_lateral"][:, 0] > at["left_knee_medial"][:, 0]).all()
    assert (at["left_malleolus_lateral"][:, 2] < at["left_malleolus_medial"][:, 2]).all()
    assert (at["c7"][:, 2] > at["sternal_notch"][:, 2]).all()


def test_labels_project_where_the_renderer_draws_them(body):
    """From each side of a nearly naked body a marker counts as seen just where its skin is the drawn surface."""
    from muybridge.errors import MissingExtraError
    from muybridge.train.synthesis.clothing.sample import sample_outfit
    from muybridge.train.synthesis.rendering.renderer import Renderer
    from muybridge.train.synthesis.rendering.view import View, look_at

    try:
        renderer = Renderer(body)
    except MissingExtraError as error:
        pytest.skip(str(error))
    body.rng = body.poses.rng = np.random.default_rng(2)
    poses = body.poses.sample(1, kinds=("stand",))
    batch = body.pose(poses.rotvec * 0, body.sample_phenotypes(1) * 0 + 0.6, poses.kinds)
    renderer.load(batch.vertices[0])
    seen = {}
    for name, y in (("front", -4.0), ("back", 4.0)):
        view = View(look_at(np.array([0.0, y, 1.0]), np.array([0.0, 0.0, 0.9])), 800, (255.5, 255.5), 512, 512)
        shot = renderer.render(view, sample_outfit(np.random.default_rng(0), 0.0), batch.landmarks[0])
        x, row = np.round(shot.markers_px).astype(int).T
        near = np.max([shot.rgba[row + j, x + i, 3] for i in (-2, 0, 2) for j in (-2, 0, 2)], 0)
        assert (near > 0).all()  # all lie on the silhouette's inside
        np.testing.assert_allclose(shot.markers_px, view.project(renderer.loaded.markers)[0], atol=1e-3)
        seen[name] = dict(zip(SURFACE.names, shot.markers_visible, strict=True))
    for name in ("left_asis", "right_asis", "sternal_notch", "xiphoid", "left_patella", "right_tibial_tuberosity"):
        assert seen["front"][name] and not seen["back"][name], name
    for name in ("c7", "t10", "left_psis", "right_psis", "right_scapula", "left_heel"):
        assert seen["back"][name] and not seen["front"][name], name


def test_limbs_hide_markers(body):
    from muybridge.train.synthesis.bodies.surface_markers import markers_seen

    point, up = np.zeros((1, 3), np.float32), np.array([[0, 0, 1]], np.float32)
    eye, depth = np.array([0.0, 0, 3]), np.array([3.0], np.float32)
    for front, normal, expected in ((2.98, up, True), (2.85, up, False), (3.0, -up, False)):
        assert markers_seen(point, normal, eye, depth, np.array([front], np.float32), 1.7)[0] == expected


def test_renders_without_marker_labels_load_as_unknown(tmp_path):
    pytest.importorskip("torch")
    from muybridge.train.synthesis.rendering.store import load_renders

    rng = np.random.default_rng(0)
    for number in (0, 1):
        np.save(tmp_path / f"renders-{number:05d}.npy", np.zeros((3, 5, 4, 4), np.uint8))
        labels = {"landmarks_px": rng.random((3, 23, 2)), "visible": np.ones((3, 23), bool), "box_px": np.ones((3, 4))}
        np.savez(tmp_path / f"renders-{number:05d}.npz", **labels)
    px = rng.random((3, len(SURFACE), 2)).astype("f4")
    np.savez(tmp_path / "markers-00001.npz", markers_px=px, markers_visible=np.ones((3, len(SURFACE)), bool))
    store = load_renders(tmp_path)
    assert len(store) == 6 and np.isnan(store.markers_px[:3]).all() and not store.markers_visible[:3].any()
    np.testing.assert_array_equal(store.markers_px[3:], px)
    assert store.markers_visible[3:].all()


def test_markers_are_exported_as_c3d_with_plug_in_gait_names(tmp_path):
    t, m = 4, len(SURFACE)
    world = np.random.default_rng(1).random((t, m, 3))
    world[2, SURFACE.index("left_asis")] = np.nan
    points = Points3D(
        SURFACE, world, np.full((t, m, 3, 3), np.nan), np.zeros((2, t, m)), np.ones((2, t, m), bool), 100.0
    )
    write_c3d(tmp_path / "take.c3d", select_markers(points, PLUG_IN_GAIT))
    back = read_c3d(tmp_path / "take.c3d")
    assert tuple(back.landmarks.names) == PLUG_IN_GAIT.labels
    expected = world[:, SURFACE.index("left_asis")]
    np.testing.assert_allclose(back.points_world[:, back.landmarks.index("LASI")], expected, atol=1e-5)
