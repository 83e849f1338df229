"""Generated motion: limits, contacts, the floor, flights, balance, smoothness, symmetry, determinism."""

import time

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("anny")

from muybridge.geometry.ik.two_bone import solve_two_bone  # noqa: E402
from muybridge.geometry.numerics.rotations import quat_from_matrix  # noqa: E402
from muybridge.geometry.skeleton.mass import centre_of_mass  # noqa: E402
from muybridge.geometry.skeleton.motion import Motion  # noqa: E402
from muybridge.motion.contacts.find import find_contacts  # noqa: E402
from muybridge.motion.contacts.footskate import sliding_frames  # noqa: E402
from muybridge.train.synthesis.bodies.body_model import KINDS  # noqa: E402
from muybridge.train.synthesis.bodies.pose_sampler import KINDS as STATIC  # noqa: E402
from muybridge.train.synthesis.motions.floor import sit  # noqa: E402
from muybridge.train.synthesis.motions.ground_contact import TRUNK_BONES, chosen_skin  # noqa: E402
from muybridge.train.synthesis.motions.hands import HABITS, hands_at_rest  # noqa: E402
from muybridge.train.synthesis.motions.rig import LIMITS, SIDES, forward, joint_angles, log, skin, turn  # noqa: E402
from muybridge.train.synthesis.motions.sampler import MOTIONS, MotionSampler  # noqa: E402
from muybridge.train.synthesis.motions.stage import Stage  # noqa: E402
from muybridge.train.synthesis.motions.standing import stand  # noqa: E402

FPS = 60.0
OFF_THE_FEET = ("crawl", "lie", "get_up", "floor_sit", "handstand", "cartwheel")


@pytest.fixture(scope="module")
def phenotypes(body):
    rng_before = body.rng
    body.rng = np.random.default_rng(8)
    drawn = body.sample_phenotypes(3)
    body.rng = rng_before
    return drawn


@pytest.fixture(scope="module")
def skeleton(body, phenotypes):
    return body.skeleton(phenotypes[0])


@pytest.fixture(scope="module")
def clips(skeleton):
    """Two clips of 5 s of every kind."""
    sampler = MotionSampler(skeleton, np.random.default_rng(21))
    return {kind: [sampler.sample(5.0, FPS, kind) for _ in range(2)] for kind in MOTIONS}


def everything(clips):
    return [clip for group in clips.values() for clip in group]


def test_forward_kinematics_are_the_body_models(body, phenotypes, skeleton):
    rotvec = body.poses.sample(4).rotvec
    _, _, _, joints = body.forward(rotvec, np.repeat(phenotypes[:1], 4, 0))
    _, at = forward(skeleton, turn(rotvec), np.zeros((4, 3)))
    assert np.abs(at - (joints - joints[:, :1])).max() < 1e-5


def test_two_bone_reaches_what_can_be_reached():
    rng = np.random.default_rng(0)
    upper, lower, hinge = np.array([0.03, -0.03, -0.44]), np.array([0.04, 0.03, -0.45]), np.array([1.0, 0, 0])
    reach = rng.normal(size=(200, 3))
    reach *= rng.uniform(0.3, 0.87, (200, 1)) / np.linalg.norm(reach, axis=1, keepdims=True)
    rotation, angle = solve_two_bone(upper, lower, hinge, reach, np.tile([1.0, 0.2, 0.1], (200, 1)), (-7, 158))
    bend = turn(np.radians(angle)[:, None] * hinge)
    end = np.einsum("tij,tj->ti", rotation, upper + bend @ lower)
    assert np.abs(end - reach).max() < 1e-9
    assert np.allclose(np.linalg.det(rotation), 1)


def test_joint_angles_are_what_the_conventions_say(skeleton):
    local = np.tile(np.eye(3), (1, len(skeleton.bones), 1, 1))
    local[0, skeleton.index("upperleg01.R")] = turn(np.radians(np.array([-100.0, 0, 0])))  # thigh flexion is -x
    local[0, skeleton.index("upperleg01.L")] = turn(np.radians(np.array([0, -30.0, 0])))  # out to the left
    local[0, skeleton.index("lowerleg01.L")] = turn(np.radians(np.array([70.0, 0, 0])))  # knee flexion is +x
    angles = joint_angles(skeleton, local)
    assert angles["hip_flexion"][0] == pytest.approx([0, 100], abs=1e-6)
    assert angles["hip_abduction"][0] == pytest.approx([30, 0], abs=1e-6)
    assert angles["knee"][0] == pytest.approx([70, 0], abs=1e-6)


@pytest.mark.parametrize("kind", list(MOTIONS))
def test_joints_stay_within_their_limits(skeleton, clips, kind):
    for clip in clips[kind]:
        for name, angle in joint_angles(skeleton, turn(clip.rotvec)).items():
            low, high = LIMITS[name]
            assert angle.min() >= low and angle.max() <= high, name


@pytest.mark.parametrize("kind", [k for k in MOTIONS if k not in OFF_THE_FEET or k == "get_up"])
def test_planted_feet_stay_where_they_are(skeleton, clips, kind):
    planted = 0
    for clip in clips[kind]:
        _, at = forward(skeleton, turn(clip.rotvec), clip.root)
        for j, (side, _) in enumerate(SIDES):
            toes = [i for i, b in enumerate(skeleton.bones) if b.startswith("toe") and b.endswith("-1." + side)]
            assert not sliding_frames(at[:, toes].mean(1), clip.contacts[:, j]).any()
            planted += int(clip.contacts[:, j].sum())
    assert planted > 30


@pytest.mark.parametrize("kind", ["stand", "walk", "run", "jump", "kick"])
def test_contacts_are_detected_from_the_motion_alone(skeleton, clips, kind):
    """Against the script's own contacts of the balls: F1 of the frames."""
    both = np.zeros(3)
    for clip in clips[kind]:
        motion = Motion(skeleton.joints, FPS, clip.root, quat_from_matrix(turn(clip.rotvec)))
        found = find_contacts(motion, roles=skeleton.roles).contact[:, :, 1]
        both += [(found & clip.contacts).sum(), found.sum(), clip.contacts.sum()]
    assert 2 * both[0] / (both[1] + both[2]) > 0.9


@pytest.mark.parametrize("kind", list(MOTIONS))
def test_the_lowest_vertex_is_on_the_floor_unless_in_flight(body, phenotypes, clips, kind):
    for clip in clips[kind][:2]:
        some = np.linspace(3, len(clip.root) - 4, 12).astype(int)
        flying = np.zeros(len(clip.root), bool)
        for a, b in clip.flights:
            flying[a : b + 1] = True
        _, _, _, joints = body.forward(clip.rotvec[some], np.repeat(phenotypes[:1], len(some), 0))
        lowest = clip.root[some, 2] - joints[:, 0, 2]  # `forward` puts the lowest vertex at 0
        assert lowest.min() > (-0.02 if kind in OFF_THE_FEET else -0.01)
        # From foot to hand a wheel is all but in the air.
        high = 0.12 if kind == "cartwheel" else 0.02 if kind in OFF_THE_FEET else 0.01
        assert lowest[~flying[some]].max() < high


@pytest.mark.parametrize("kind", ["run", "jump", "somersault"])
def test_flights_are_parabolas(skeleton, clips, kind):
    flights = 0
    for clip in clips[kind]:
        _, at = forward(skeleton, turn(clip.rotvec), clip.root)
        com = centre_of_mass(at, skeleton.roles)
        for a, b in clip.flights:
            acceleration = np.diff(com[a : b + 1], 2, axis=0) * FPS**2
            assert np.abs(acceleration - [0, 0, -9.81]).max() < 0.05
            assert not clip.contacts[a + 1 : b].any()
            flights += 1
    assert flights >= 3


@pytest.mark.parametrize("kind", ["stand", "balance", "squat"])
def test_the_centre_of_mass_is_over_the_feet(skeleton, clips, kind):
    for clip in clips[kind]:
        _, at = forward(skeleton, turn(clip.rotvec), clip.root)
        com = centre_of_mass(at, skeleton.roles)[:, :2]
        feet = np.stack([np.stack([at[:, skeleton.index(b + s), :2] for b in ("foot.", "toe2-1.")], 1)
                         for s, _ in SIDES], 1)  # fmt: skip
        share = np.linspace(0, 1, 15)
        # Distance to the nearest foot on one leg, to the line between the feet on two.
        spots = (feet[:, :, :1] * (1 - share[:, None]) + feet[:, :, 1:] * share[:, None]) if share.size else feet
        one = clip.contacts.sum(1) == 1
        standing = np.where(clip.contacts[:, 0], 0, 1)
        near = np.linalg.norm(spots[np.arange(len(com)), standing] - com[:, None], axis=2).min(1)
        assert (near[one] < 0.06).mean() > 0.97 if one.any() else True
        middles = spots.mean(2)
        line = middles[:, :1] * (1 - share[:, None]) + middles[:, 1:] * share[:, None]
        assert (np.linalg.norm(line - com[:, None], axis=2).min(1)[~one] < 0.08).mean() > 0.97


def test_motion_is_smooth(skeleton, clips):
    for clip in everything(clips):
        local = turn(clip.rotvec)
        step = np.degrees(np.linalg.norm(log(np.swapaxes(local[:-1], -1, -2) @ local[1:]), axis=-1))
        assert step.max() < 2200 / FPS, clip.kind
        assert np.linalg.norm(np.diff(clip.root, axis=0), axis=1).max() * FPS < 7.5, clip.kind


def test_no_gross_self_penetration(body, phenotypes, clips):
    bad = []
    for clip in everything(clips):
        _, _, height, joints = body.forward(clip.rotvec[5::50], np.repeat(phenotypes[:1], len(clip.root[5::50]), 0))
        bad.append(body.penetrates(joints, height))
    assert np.concatenate(bad).mean() < 0.01


def test_kinds_are_what_they_say(skeleton, clips):
    at = {k: [forward(skeleton, turn(c.rotvec), c.root)[1] for c in v] for k, v in clips.items()}
    head, root = skeleton.index("head"), 0
    tall = skeleton.rest[head, 2]
    assert all(a[:, head, 2].min() > 0.85 * tall for a in at["stand"] + at["walk"])
    assert all(a[:, head, 2].max() < 0.6 * tall for a in at["crawl"] + at["lie"])
    assert all(a[:, root, 2].min() < 0.8 * skeleton.rest[0, 2] for a in at["squat"] + at["kneel"] + at["sit"])
    for a in at["get_up"]:
        assert a[:, head, 2].min() < 0.3 * tall and a[:, head, 2].max() > 0.9 * tall
    for a in at["handstand"] + at["plank"]:
        hands = a[:, [skeleton.index("wrist." + s) for s, _ in SIDES]]
        assert np.ptp(hands, axis=0).max() < 0.02 and hands[..., 2].max() < 0.08
    assert all((a[:, head, 2] < a[:, root, 2]).all() for a in at["handstand"])
    assert all((a[:, head, 2] < a[:, root, 2]).any() for a in at["cartwheel"])
    assert any((a[:, head, 2] < a[:, root, 2]).any() for a in at["somersault"])
    assert all(a[:, root, 2].max() < 0.3 * skeleton.rest[0, 2] for a in at["floor_sit"])
    for kind, low, high in (("walk", 0.5, 2.2), ("run", 1.6, 5.0), ("crawl", 0.1, 1.2), ("stand", 0.0, 0.4)):
        for a in at[kind]:
            assert low <= np.linalg.norm(np.diff(a[:, 0, :2], axis=0), axis=1).sum() / 5.0 <= high, kind
    for a in at["crawl"]:  # on hands and knees, the face down
        assert (a[:, skeleton.index("toe2-1.L"), 2] < a[:, root, 2]).all()


def lowest(skeleton, clip, bones):
    """(T,) metres, the lowest point of the skin of some bones."""
    rotations, at = forward(skeleton, turn(clip.rotvec), clip.root)
    return skin(skeleton, rotations, at, chosen_skin(skeleton, bones))[..., 2].min(1)


def test_who_lies_does_not_hover(skeleton, clips):
    everything = np.concatenate([lowest(skeleton, c, TRUNK_BONES) for c in clips["lie"]])
    assert everything.max() < 0.06  # on a side the shoulder bears, which is not the trunk's
    for bones in (("head",), ("lowerarm", "wrist", "finger"), ("foot", "toe")):
        clear = np.concatenate([lowest(skeleton, c, bones) for c in clips["lie"]])
        assert clear.min() > -0.02 and np.median(clear) < 0.10, bones


def test_who_crawls_is_on_hands_and_knees(skeleton, clips):
    for clip in clips["crawl"]:
        knees = np.stack([lowest(skeleton, clip, (f"upperleg02.{s}", f"lowerleg01.{s}")) for s, _ in SIDES])
        hands = np.stack([lowest(skeleton, clip, (f"wrist.{s}", f"finger3-2.{s}")) for s, _ in SIDES])
        assert np.abs(knees.min(0)).max() < 0.02 and np.abs(knees).max() < 0.10
        assert np.abs(hands.min(0)).max() < 0.03 and hands.max() < 0.16


def test_mirroring_exchanges_left_and_right(skeleton, clips):
    sampler = MotionSampler(skeleton, np.random.default_rng(0))
    clip = clips["walk"][0]
    mirrored = sampler.mirrored(clip)
    _, at = forward(skeleton, turn(clip.rotvec), clip.root)
    _, other = forward(skeleton, turn(mirrored.rotvec), mirrored.root)
    assert np.abs(other[:, sampler.mirror] - at * [-1, 1, 1]).max() < 2e-3  # the body at rest is as symmetric
    again = sampler.mirrored(mirrored)
    assert np.array_equal(again.rotvec, clip.rotvec) and np.array_equal(again.contacts, clip.contacts)


def test_both_sides_act_equally_often(skeleton):
    poses = MotionSampler(skeleton, np.random.default_rng(4)).sample_poses(480, ("balance", "kick"))
    hips = [poses.rotvec[:, skeleton.index("upperleg01." + s)] for s, _ in SIDES]
    lifted = [np.linalg.norm(h, axis=1) > np.radians(30) for h in hips]
    left, right = lifted[0].sum(), lifted[1].sum()
    assert left > 40 and right > 40


def test_the_same_seed_gives_the_same_motion(skeleton):
    one, two, other = (MotionSampler(skeleton, np.random.default_rng(s)).sample(3.0, 30.0) for s in (6, 6, 7))
    assert one.kind == two.kind and np.array_equal(one.rotvec, two.rotvec) and np.array_equal(one.root, two.root)
    assert not np.array_equal(one.root, other.root)


def test_two_people_meet_without_running_into_one_another(skeleton):
    sampler = MotionSampler(skeleton, np.random.default_rng(2))
    met = 0
    for _ in range(8):
        pair = sampler.sample_pair(4.0, 30.0)
        at = [forward(skeleton, turn(c.rotvec), c.root)[1] for c in pair]
        trunks = [a[:, [0, skeleton.index("spine01"), skeleton.index("head")]] for a in at]
        apart = np.linalg.norm(trunks[0][:, :, None] - trunks[1][:, None], axis=-1)
        assert apart.min() > 0.25 and apart[:, 0, 0].max() < 1.6
        hands = [a[:, [skeleton.index("wrist." + s) for s, _ in SIDES]] for a in at]
        met += bool(np.linalg.norm(hands[0][:, :, None] - hands[1][:, None], axis=-1)[60].min() < 0.15)
    assert met >= 3


def test_other_bodies_stand_on_the_floor_too(body, phenotypes):
    for one in phenotypes[1:]:
        skeleton = body.skeleton(one)
        clip = MotionSampler(skeleton, np.random.default_rng(3)).sample(3.0, FPS, "walk")
        _, _, _, joints = body.forward(clip.rotvec[::20], np.repeat(one[None], len(clip.root[::20]), 0))
        assert np.abs(clip.root[::20, 2] - joints[:, 0, 2]).max() < 0.012


def test_ten_seconds_take_less_than_two(skeleton):
    sampler = MotionSampler(skeleton, np.random.default_rng(9))
    sampler.sample(1.0, FPS, "walk")
    spent = []
    for _ in range(3):
        start = time.process_time()
        sampler.sample(10.0, FPS, "dance")
        spent.append(time.process_time() - start)
    assert min(spent) < 2.0


def test_bodies_are_drawn_from_both_samplers_and_repeat_with_the_seed(body):
    batches = []
    for _ in range(2):
        body.rng = body.poses.rng = np.random.default_rng(12)
        batches.append(body.sample(40))
    assert np.array_equal(batches[0].landmarks, batches[1].landmarks)
    moving = np.mean(batches[0].kinds >= len(STATIC))
    assert 0.35 < moving < 0.9 and batches[0].kinds.max() < len(KINDS)


def test_a_clip_too_short_or_of_no_known_kind_is_refused(skeleton):
    sampler = MotionSampler(skeleton, np.random.default_rng(0))
    with pytest.raises(ValueError, match="too short"):
        sampler.sample(0.05, 60.0)
    with pytest.raises(ValueError, match="unknown kind"):
        sampler.sample(1.0, 60.0, "swim")


def posed(skeleton, name, monkeypatch):
    """Joints (F, bones, 3), in the axes of the pelvis, of a clip with this habit of the hands."""
    monkeypatch.setattr("muybridge.train.synthesis.motions.hands.HABITS", {name: HABITS[name]})
    sampler = MotionSampler(skeleton, np.random.default_rng(31))
    seated = HABITS[name].share[0] == 0

    def programme(g: Stage) -> None:
        (sit if seated else stand)(g)
        hands_at_rest(g, seated)

    clip = sampler._best("pair", np.arange(60) / 15, 15.0, programme)
    assert sum(sampler.faults(clip).values()) == 0
    rotations, at = forward(skeleton, turn(clip.rotvec), clip.root)
    return np.einsum("tij,tbi->tbj", rotations[:, 0], at - at[:, :1])


@pytest.mark.parametrize("name", HABITS)
def test_hands_rest_where_people_rest_them(skeleton, name, monkeypatch):
    at = posed(skeleton, name, monkeypatch) / skeleton.height
    wrists = np.stack([at[:, skeleton.index("wrist." + s)] for s, _ in SIDES], 1)
    hips, head = at[:, skeleton.index("root")], at[:, skeleton.index("head")]
    apart = np.linalg.norm(wrists[:, 0] - wrists[:, 1], axis=-1).min()
    to_hips, to_head = (np.linalg.norm(wrists - x[:, None], axis=-1).min() for x in (hips, head))
    if name in ("folded", "clasped", "behind", "holding"):
        assert apart < 0.2
    if name in ("ear", "chin", "nape"):
        assert to_head < 0.15
    if name in ("hips", "hip", "pockets", "pocket", "clasped", "behind"):
        assert to_hips < 0.2
    if name == "folded":  # each wrist is on the other side
        crossed = (wrists[:, 0, 0] < 0) & (wrists[:, 1, 0] > 0)
        assert crossed.mean() > 0.3
    if name == "behind":
        assert (wrists[..., 1] > 0.02).any(0).all()


def test_kinds_that_are_asked_for_are_the_only_ones(body):
    before, body.kinds = body.kinds, ("sit",)
    body._frames = []
    try:
        assert {KINDS[k] for k in body.sample(6).kinds} == {"sit"}
    finally:
        body.kinds, body._frames = before, []
