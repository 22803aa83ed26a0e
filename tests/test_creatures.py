"""Creatures: bodies of their own, feet that stand, gaits in their order, styles that show, one score told again."""

import math
import random

import pytest
import torch

import motionkit as mk
from motionkit import actor
from motionkit import rotations as rot
from motionkit.actor import Performer, Style, bodies, performing
from motionkit.actor.pose import ankles, leg_turns, rest_legs
from motionkit.actor.style import HELD_OUT_STYLES, TRAIN_STYLES
from motionkit.contacts import foot_sliding

KINDS = performing.CREATURES
BEASTS = tuple(k for k in KINDS if k != "humanoid")


def lowest(motion):
    """The lowest joint or bone end, metres."""
    places, turns = motion.positions(), motion.world_rotations()
    ends = [places[:, j] + rot.quaternion_rotate(turns[:, j], torch.tensor(o)) for j, o in motion.skeleton.end_sites]
    return min(float(places[..., 1].min()), *(float(end[:, 1].min()) for end in ends))


def joint(performance, name):
    return performance.motion.positions()[:, performance.motion.skeleton.index(name)]


def test_bodies_differ():
    skeletons = [performing.get_creature(kind).skeleton for kind in KINDS]
    assert len(KINDS) == 5
    assert len({len(s) for s in skeletons}) == 5
    assert len(performing.get_creature("humanoid").skeleton) == 31
    assert not set(skeletons[0].names) & set(skeletons[1].names)
    for skeleton in skeletons:
        assert {"left", "right", "middle"} == set(skeleton.sides)
        assert skeleton.mirror_joints is not None


@pytest.mark.parametrize("kind", KINDS)
def test_rest_pose_is_a_mirror_image_that_stands_on_the_ground(kind):
    creature = performing.get_creature(kind)
    rest, twins = creature.rest, list(creature.skeleton.mirror_joints)
    torch.testing.assert_close(rest[twins] * torch.tensor([-1.0, 1.0, 1.0]), rest, atol=1e-9, rtol=0)
    assert rest[:, 1].min() >= 0


@pytest.mark.slow
@pytest.mark.parametrize("kind", BEASTS)
def test_feet_stand_where_contacts_say(kind):
    creature, chance = performing.get_creature(kind), random.Random(kind)
    for content in creature.contents:
        for style in chance.sample(TRAIN_STYLES + HELD_OUT_STYLES, 2):
            done = performing.perform_creature(content, style, chance.randrange(99), seconds=8, creature=kind)
            feet = done.performer.feet
            assert done.contacts.shape == (240, len(feet))
            joints = [done.motion.skeleton.index(f) for f in feet]
            places = done.motion.positions().double()[:, joints]
            both = done.contacts[1:] & done.contacts[:-1]
            steps = torch.linalg.vector_norm(places[1:] - places[:-1], dim=-1)[both]
            assert float(steps.max()) < 1e-4, (content, style)
            assert lowest(done.motion) > -0.005, (content, style)
            level = done.performer.rest[[done.performer.skeleton.index(f) for f in feet], 1]
            assert float((places[..., 1] - level).abs()[done.contacts].max()) < 1e-4


@pytest.mark.parametrize("kind", KINDS)
def test_bones_keep_their_lengths_and_files_give_the_motion_back(kind, tmp_path):
    content = performing.get_creature(kind).contents[0]
    motion = performing.perform_creature(content, "proud", 3, seconds=3, creature=kind).motion
    places = motion.positions()
    for j, parent in enumerate(motion.skeleton.parents):
        if parent >= 0:
            length = torch.linalg.vector_norm(places[:, j] - places[:, parent], dim=-1)
            assert float((length - motion.skeleton.offsets[j].norm()).abs().max()) < 1e-5
    mk.save(motion, tmp_path / "creature.bvh")
    again = mk.load(tmp_path / "creature.bvh", metres_per_unit=1.0)
    assert again.skeleton.same_tree(motion.skeleton)
    torch.testing.assert_close(again.positions(), places, atol=1e-4, rtol=0)
    torch.testing.assert_close(motion.mirror().mirror().positions(), places, atol=1e-4, rtol=0)


def landings(performance):
    """Frames in which each foot begins to stand, one list a foot."""
    starts = performance.contacts[1:] & ~performance.contacts[:-1]
    return [torch.nonzero(starts[:, n])[:, 0] + 1 for n in range(starts.shape[1])]


def phase_of(performance, foot, reference):
    """When in the reference foot's cycle a foot lands, 0 to 1, median over its landings."""
    ours, cycle = landings(performance)[foot].double(), landings(performance)[reference].double()
    inside = ours[(ours >= cycle[0]) & (ours < cycle[-1])]
    n = torch.searchsorted(cycle, inside, right=True) - 1
    angle = 2 * math.pi * (inside - cycle[n]) / (cycle[n + 1] - cycle[n])
    return float(torch.atan2(angle.sin().mean(), angle.cos().mean()) / (2 * math.pi) % 1.0)


def test_a_dog_walks_in_lateral_sequence_and_trots_in_diagonal_pairs():
    steady = Style("steady", variability=0.0)
    walk = performing.perform_creature("walk", steady, 1, seconds=8, fps=120, creature="dog")
    assert walk.performer.feet == ("LeftHindPaw", "RightHindPaw", "LeftForePaw", "RightForePaw")
    assert [round(phase_of(walk, n, 0), 1) for n in (1, 2, 3)] == pytest.approx([0.5, 0.25, 0.75], abs=0.06)
    trot = performing.perform_creature("trot", steady, 1, seconds=8, fps=120, creature="dog")
    assert phase_of(trot, 2, 1) == pytest.approx(0.0, abs=0.02) or phase_of(trot, 2, 1) > 0.98
    assert phase_of(trot, 1, 0) == pytest.approx(0.5, abs=0.02)


def test_a_walk_always_stands_on_most_legs_and_a_run_leaps():
    for kind, least in (("dog", 2), ("crab", 4), ("dragon", 2), ("ostrich", 1)):
        assert int(performing.perform_creature("walk", seed=2, creature=kind).contacts.sum(1).min()) >= least
    run = performing.perform_creature("run", seed=2, creature="ostrich")
    assert int(run.contacts.sum(1).min()) == 0
    speed = [
        float((p.motion.root_path()[-1] - p.motion.root_path()[0]).norm())
        for p in (run, performing.perform_creature("walk", seed=2, creature="ostrich"))
    ]
    assert speed[0] > 1.5 * speed[1]


def test_a_crab_goes_sideways():
    walk = performing.perform_creature("walk", seed=4, creature="crab")
    way = walk.motion.root_path()[-1] - walk.motion.root_path()[0]
    assert abs(float(walk.motion.facing()[0])) < 0.3
    assert abs(float(way[0])) > 4 * abs(float(way[1]))


@pytest.mark.parametrize(
    "kind, head, tail", [("dog", "Head", "Tail3"), ("ostrich", "head", "tail2"), ("dragon", "HeadBone", "TailBone7")]
)
def test_the_proud_carry_head_and_tail_high_and_the_tired_low(kind, head, tail):
    proud, neutral, tired = (
        performing.perform_creature("walk", s, 5, creature=kind) for s in ("proud", "neutral", "tired")
    )
    size = neutral.performer.leg
    heads, tails = ([float(joint(p, name)[:, 1].mean()) / size for p in (proud, neutral, tired)]
                    for name in (head, tail))  # fmt: skip
    assert heads[1] - heads[2] > 0.1
    assert tails[0] > tails[1] > tails[2]
    if kind != "ostrich":  # whose neck stands upright already
        assert heads[0] - heads[1] > 0.05
    times = [len(landings(p)[0]) for p in (proud, tired)]
    assert times[0] > 1.4 * times[1]


def test_deeds_look_like_what_they_are_called():
    sit = performing.perform_creature("sit", seed=1, creature="dog")
    assert float(joint(sit, "Hips")[:, 1].min()) < 0.5 * float(joint(sit, "Hips")[0, 1])
    assert float(joint(sit, "Head")[:, 1].min()) > 0.8 * float(joint(sit, "Head")[0, 1])
    threat = performing.perform_creature("threat", seed=1, creature="crab")
    claw = joint(threat, "left_claw_finger")[:, 1]
    assert float(claw.max()) > 2 * float(claw[0])
    peck = performing.perform_creature("peck", seed=1, creature="ostrich")
    assert float(joint(peck, "beak")[:, 1].min()) < 0.15 < 1.5 < float(joint(peck, "beak")[0, 1])
    roar = performing.perform_creature("roar", seed=1, creature="dragon")
    span = torch.linalg.vector_norm(joint(roar, "WingTip_L") - joint(roar, "WingTip_R"), dim=-1)
    assert float(span.max()) > 2.5 * float(span[0])


@pytest.mark.parametrize("kind", KINDS)
def test_a_score_told_again_agrees_beat_by_beat(kind):
    deed = next(iter(performing.get_creature(kind).species.actions))
    first = performing.perform_creature(f"walk, {deed}", "neutral", 6, seconds=9, creature=kind)
    other = mk.actor.retell(first, "tired")
    assert other.performer is first.performer and other.score is first.score
    assert len(other) > 1.2 * len(first)
    along = other.time_aligned(first)
    assert len(along) == len(first)
    same = mk.actor.retell(first, "neutral")
    torch.testing.assert_close(
        same.time_aligned(first).positions()[:-2], first.motion.positions()[:-2], atol=2e-3, rtol=0
    )


def test_the_actor_takes_creatures_for_performers():
    asked = actor.perform("trot", "proud", 2, seconds=3, performer="dog")
    assert torch.equal(
        asked.motion.rotations, performing.perform_creature("trot", "proud", 2, seconds=3).motion.rotations
    )
    assert actor.retell(asked, "tired").performer is asked.performer
    assert asked.parameters["performer"]["height"] == asked.performer.height


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_again_and_another_take(kind):
    first, again, other = (
        performing.perform_creature("walk", seed=seed, seconds=3, creature=kind) for seed in (7, 7, 8)
    )
    assert torch.equal(first.motion.rotations, again.motion.rotations)
    assert float((first.motion.rotations - other.motion.rotations).abs().max()) > 0.01


@pytest.mark.parametrize("kind", BEASTS)
def test_a_path_is_followed(kind):
    path = torch.tensor([[0.0, 0.0], [0.0, 4.0], [2.0, 8.0]])
    walk = performing.perform_creature("walk", seed=1, seconds=10, creature=kind, path=path)
    places = walk.motion.root_path()
    assert float(places[-1, 1]) > 1.0
    away = torch.cdist(places.double(), torch.stack([torch.lerp(a, b, t) for a, b in zip(path, path[1:])
                                                     for t in torch.linspace(0, 1, 50)]).double())  # fmt: skip
    assert float(away.amin(1).max()) < 0.9


def test_the_humanoid_is_a_person_on_another_rig():
    person = performing.perform_creature("walk", "old", 2, seconds=4, creature="humanoid")
    feet = list(person.performer.feet)
    assert foot_sliding(person.motion, person.contacts, feet) < 1.0
    same = actor.perform("walk", "old", 2, seconds=4, performer=Performer(2, 1.75 * person.performer.size, 0.0,
                                                                         person.performer.habits))  # fmt: skip
    assert torch.equal(person.contacts, same.contacts)
    ours = person.motion.positions()[:, [person.motion.skeleton.index(f) for f in feet]]
    theirs = same.motion.positions()[:, list(same.motion.skeleton.feet())]
    torch.testing.assert_close(ours, theirs, atol=1e-4, rtol=0)
    assert person.motion.skeleton.feet() == tuple(person.motion.skeleton.index(f) for f in feet)


def test_three_bone_legs_end_where_they_should():
    creature = performing.get_creature("dog")
    rest = rest_legs(creature.species, creature.size)
    places = creature.rest[torch.tensor(rest.joints)]  # [L, 4, 3]
    chance = torch.Generator().manual_seed(0)
    hip = places[:, 0] + 0.05 * torch.randn(50, len(places), 3, generator=chance, dtype=torch.float64)
    toe = places[:, 3].expand_as(hip)
    yaw = pitch = torch.zeros(hip.shape[:2], dtype=torch.float64)
    ankle = ankles(rest, hip, toe, yaw, pitch)
    turns = leg_turns(rest, hip, ankle, toe, rest.knee.expand_as(hip))
    bones = places[:, 1:] - places[:, :-1]
    end = hip + rot.quaternion_rotate(turns, bones.expand(50, -1, -1, -1)).sum(2)
    reachable = torch.linalg.vector_norm(hip - toe, dim=-1) < 0.98 * (rest.upper + rest.lower + rest.foot)
    assert float((end - toe).abs()[reachable].max()) < 1e-9
    at_rest = leg_turns(rest, places[None, :, 0], places[None, :, 2], places[None, :, 3], rest.knee[None])
    torch.testing.assert_close(at_rest, rot.identity_quaternion(1, len(places), 3, dtype=torch.float64))


@pytest.mark.parametrize(
    "wrong, said",
    [
        (lambda: performing.perform_creature("walk", creature="dogg"), "did you mean 'dog'"),
        (lambda: performing.perform_creature("tro", creature="dog"), "a dog has no content 'tro'; did you mean 'trot'"),
        (lambda: performing.perform_creature("sit", creature="crab"), "a crab has no content 'sit'.*threat"),
        (lambda: performing.perform_creature([], creature="dog"), "a dog can walk"),
        (lambda: performing.perform_creature("walk", "tierd", creature="dog"), "did you mean 'tired'"),
        (lambda: performing.perform_creature("sit", seconds=1, creature="dog"), "one sit of a dog takes 7 beats"),
        (lambda: performing.perform_creature("walk, sit", seconds=1, creature="dog"), "at least"),
        (lambda: performing.perform_creature("walk", seconds=math.nan, creature="dog"), "seconds: expected a number"),
        (lambda: performing.perform_creature("walk", path=[[0, 0]], creature="dog"), "at least two"),
        (lambda: bodies.Creature(performing.get_creature("dog").species, size=90), "size is 0.2 to 5"),
    ],
)
def test_mistakes_are_explained(wrong, said):
    with pytest.raises(mk.MotionKitError, match=said):
        wrong()
