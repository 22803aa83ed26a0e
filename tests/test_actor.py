"""The performer: feet that stand, bones that keep their length, bodies within human limits, truth that is exact."""

import math
import warnings
from pathlib import Path

import pytest
import torch

import make_styles
import motionkit as mk
from motionkit.actor import CONTENTS, Performer, Style, mix, parameters, perform, retell
from motionkit.actor.bodies import HEEL
from motionkit.actor.style import HELD_OUT_STYLES, TRAIN_STYLES, get_style

pytestmark = pytest.mark.slow

STYLES = (*TRAIN_STYLES, *HELD_OUT_STYLES)


def angles(motion: mk.Motion, *joints: str) -> torch.Tensor:
    """Degrees between the bones that meet in the middle one of three joints, 0 where they are in line; [F]."""
    a, b, c = (motion.positions().double()[:, motion.skeleton.index(j)] for j in joints)
    cosine = torch.cosine_similarity(b - a, c - b, dim=-1)
    return torch.rad2deg(torch.acos(cosine.clamp(-1, 1)))


def acceleration(motion: mk.Motion) -> torch.Tensor:
    """Of each joint between frames, [F - 2, J], m/s^2."""
    places = motion.positions().double()
    return (places[2:] - 2 * places[1:-1] + places[:-2]).norm(dim=-1) * motion.fps**2


def lowest(performance) -> float:
    """The lowest point of soles, heels and toe tips over a clip, metres."""
    motion = performance.motion
    world, places = motion.world_rotations(), motion.positions()
    points = []
    height = performance.performer.height
    for side in ("left", "right"):
        for joint, offset in (
            ("ankle", (0, -0.039 * height, -HEEL * height)),
            ("foot", (0, -0.012 * height, 0.046 * height)),
        ):
            j = motion.skeleton.index(f"{side}_{joint}")
            offset = torch.tensor(offset, dtype=torch.float32).expand(len(motion), 3)
            points.append(places[:, j] + mk.rotations.quaternion_rotate(world[:, j], offset))
    return float(torch.stack(points)[..., 1].min())


@pytest.fixture(scope="module")
def everything() -> dict:
    """One performance of each content in each style."""
    return {(c, s): perform(c, s, seed=7, seconds=8) for c in CONTENTS for s in STYLES}


def test_names_and_shape(everything):
    assert (
        len(CONTENTS) == 12
        and len(TRAIN_STYLES) == 8
        and set(HELD_OUT_STYLES) == {"sneaky", "drunk", "robot", "zombie"}
    )
    for (content, style), p in everything.items():
        assert p.motion.skeleton.names == mk.skeleton.smpl().names
        assert (p.content, p.style.name, len(p), p.motion.fps) == (content, style, 240, 30.0)
        assert p.contacts.shape == (240, 4) and p.contacts.dtype == torch.bool
        assert p.beats.shape == (240,) and (p.beats[1:] > p.beats[:-1]).all()
        assert ((p.phase >= 0) & (p.phase < 1)).all()


def test_standing_feet_stand_and_nothing_sinks_into_the_floor(everything):
    for key, p in everything.items():
        assert mk.contacts.foot_sliding(p.motion, p.contacts) < 0.5, key
        feet = p.motion.positions()[:, mk.contacts.feet_of(p.motion)]
        both = p.contacts[1:] & p.contacts[:-1]
        assert float((feet[1:] - feet[:-1]).norm(dim=-1)[both].max()) < 0.005, key
        assert lowest(p) > -0.005, key
        assert p.contacts.any(1).float().mean() > 0.25, key


def test_bones_keep_their_length(everything):
    for p in everything.values():
        s = p.motion.skeleton
        places = p.motion.positions().double()
        bones = (places[:, 1:] - places[:, list(s.parents[1:])]).norm(dim=-1)
        assert float((bones - s.offsets[1:].double().norm(dim=-1)).abs().max()) < 1e-5


def test_joints_stay_within_human_limits(everything):
    for key, p in everything.items():
        for side in ("left", "right"):
            knee = angles(p.motion, f"{side}_hip", f"{side}_knee", f"{side}_ankle")
            elbow = angles(p.motion, f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist")
            assert float(knee.max()) < 155 and float(elbow.max()) < 150, key
            # a knee is a hinge: the shin turns about the thigh's own X axis, backwards
            turn = mk.rotations.log_map(p.motion.rotations[:, p.motion.skeleton.index(f"{side}_knee")])
            assert float(turn[:, 1:].abs().max()) < 1e-3 and float(turn[:, 0].min()) > -1e-3, key
        trunk = angles(p.motion, "pelvis", "spine2", "neck")
        assert float(trunk.max()) < 75, key


def test_same_numbers_same_motion_and_other_seeds_differ():
    one, again, other = (perform("walk", "angry", seed=s, seconds=4, performer=3) for s in (5, 5, 6))
    assert torch.equal(one.motion.rotations, again.motion.rotations)
    assert float((one.motion.positions() - other.motion.positions()).abs().max()) > 0.02


def test_cycles_and_performers_vary():
    walk = perform("walk", "neutral", seed=2, seconds=8).motion
    steps = walk.positions()[:, walk.skeleton.index("left_ankle"), 1]
    peaks = steps[1:-1][(steps[1:-1] > steps[:-2]) & (steps[1:-1] > steps[2:]) & (steps[1:-1] > steps.mean())]
    assert 0.0005 < float(peaks.std()) < 0.03
    heights = [Performer.from_seed(n).height for n in range(200)]
    assert 1.5 <= min(heights) < 1.55 and 1.9 < max(heights) <= 1.95
    tall, short = Performer(height=1.9), Performer(height=1.52)
    speeds = [perform("walk", seed=1, seconds=5, performer=x).motion.root_path() for x in (tall, short)]
    assert float((speeds[0][-1] - speeds[0][0]).norm()) > 1.05 * float((speeds[1][-1] - speeds[1][0]).norm())


@pytest.mark.parametrize("content", CONTENTS)
def test_retelling_in_the_same_style_is_the_same_motion(content):
    p = perform(content, "proud", seed=4, seconds=6)
    same = retell(p, "proud")
    assert abs(len(same) - len(p)) <= 1
    short = min(len(same), len(p))
    assert torch.allclose(same.motion[:short].positions(), p.motion[:short].positions(), atol=1e-5)


@pytest.mark.parametrize("content", CONTENTS)
def test_retelling_agrees_beat_by_beat(content):
    p = perform(content, "neutral", seed=4, seconds=6)
    truth = retell(p, "old")
    along = truth.time_aligned(p)
    assert len(along) == len(p) and along.fps == p.motion.fps
    # the same feet stand at the same beats, but for the frames in which they come and go
    frames = truth.frames_at(p.beats).round().long()
    agree = (truth.contacts[frames][:, 1::2] == p.contacts[:, 1::2]).float().mean()
    assert float(agree) > 0.88
    assert float(mk.metrics.truth_error(along, truth, p).max()) < 1e-3
    error = mk.metrics.truth_error(p.motion, truth, p)
    assert error.shape == (22,) and float(error.mean()) > 20


def test_truth_error_knows_its_answers():
    p = perform("walk", seed=1, seconds=4)
    truth = retell(p, "tired")
    exact = truth.time_aligned(p)
    assert float(mk.metrics.truth_error(exact.transform(0.7, (1.0, 0.0, 2.0)), truth, p).max()) < 0.01
    raised = exact.replace(
        translations=exact.translations + torch.tensor([0, 0.1, 0]) * (torch.arange(22) == 0)[:, None]
    )
    assert torch.allclose(mk.metrics.truth_error(raised, truth, p), torch.full((22,), 100.0), atol=0.01)
    assert float(
        mk.metrics.truth_error(exact.transform(0.0, (0.3, 0.0, 0.4)), truth, p, world=True).mean()
    ) == pytest.approx(500, abs=0.1)
    assert float(mk.metrics.truth_error(truth.motion, truth, p, beats=truth.beats).max()) < 1e-3
    mixed = [
        float(mk.metrics.truth_error(retell(p, "tired", k).time_aligned(p), truth, p).mean()) for k in (0.0, 0.5, 0.9)
    ]
    assert mixed[0] > mixed[1] > mixed[2] > 0
    with pytest.raises(mk.MotionKitError, match="frames"):
        mk.metrics.truth_error(truth.motion, truth, p)
    with pytest.raises(mk.MotionKitError, match="no retelling"):
        mk.metrics.truth_error(exact, perform("walk", seed=2, seconds=4), p)


@pytest.mark.parametrize("pair", [("proud", "strutting"), ("depressed", "tired")])
@pytest.mark.parametrize("content", ["walk", "wave", "idle"])
def test_two_pairs_of_styles_differ_in_timing_alone(pair, content):
    p = perform(content, pair[0], seed=3, seconds=5)
    other = retell(p, pair[1])
    assert float(mk.metrics.truth_error(other.time_aligned(p), other, p).mean()) < 1e-3
    assert float((other.time_aligned(p).positions() - p.motion.positions()).norm(dim=-1).mean()) < 0.01
    assert len(other) > 1.2 * len(p)


def test_intensity_and_mixing():
    assert get_style("old").at(0).values() == Style().values()
    half = mix({get_style("old"): 0.5, get_style("proud"): 0.5})
    for name in parameters():
        a, b = getattr(get_style("old"), name), getattr(get_style("proud"), name)
        assert getattr(half, name) == pytest.approx((a + b) / 2)
    much = get_style("angry").at(3.0)
    assert all(p.low <= getattr(much, n) <= p.high for n, p in parameters().items())
    neutral, mild, full = (perform("walk", "old", seed=1, seconds=4, intensity=k, performer=2) for k in (0, 0.5, 1))
    heads = [p.motion.positions()[:, 15, 1].mean() for p in (neutral, mild, full)]
    assert heads[0] > heads[1] > heads[2]


def test_a_sequence_does_each_in_turn_without_pops():
    p = perform("walk, jump, kick, walk, bow", "neutral", seed=2, seconds=22)
    assert [act.name for act in p.score.acts][:5] == ["walk", "jump", "kick", "walk", "bow"]
    assert 650 <= len(p) <= 670
    assert mk.contacts.foot_sliding(p.motion, p.contacts) < 0.5
    single = max(float(acceleration(perform(c, seed=2, seconds=6).motion).max()) for c in ("walk", "jump", "kick"))
    assert float(acceleration(p.motion).max()) < 1.3 * single
    jump = next(a for a in p.score.acts if a.name == "jump")
    inside = (p.beats > jump.start + 2.1) & (p.beats < jump.start + 2.9)
    assert not p.contacts[inside].any()
    assert 0.15 < float(p.motion.positions()[:, 0, 1].max() - p.motion.positions()[0, 0, 1]) < 0.6


def test_walks_follow_a_path_and_slow_down_where_it_is_too_sharp():
    t = torch.linspace(0, 6, 40)
    path = torch.stack((2 * torch.sin(t / 2), t), 1)
    p = perform("walk", "neutral", seed=1, seconds=7, path=path)
    way = p.motion.root_path()
    gaps = torch.cdist(
        way.double(),
        torch.stack((2 * torch.sin(torch.linspace(0, 8, 4000) / 2), torch.linspace(0, 8, 4000)), 1).double(),
    )
    assert float(gaps.min(1).values.max()) < 0.12
    facing = p.motion.facing()
    moving = torch.atan2(*(way[6:] - way[:-6]).T)
    assert float(mk.rotations.wrap_angle(facing[3:-3] - moving).abs().mean()) < 0.25
    with pytest.warns(mk.MotionKitWarning, match="sharply"):
        sharp = perform("walk", seed=1, seconds=6, path=[[0, 0], [0, 2], [0.2, 2], [0.2, 0], [0.4, 0], [0.4, 3]])
    assert mk.contacts.foot_sliding(sharp.motion, sharp.contacts) < 0.5
    with pytest.warns(mk.MotionKitWarning, match="sharply"):  # there and back: turns on the spot and goes on
        back = perform("walk", seed=1, seconds=20, path=[[0, 0], [0, 3], [0, 0.5]])
    assert float(back.motion.root_path()[-1].sub(torch.tensor([0, 0.5])).norm()) < 0.3
    short = perform("walk", seed=1, seconds=6, path=[[0, 0], [0, 1.5]])  # arrives, and stands
    assert float(short.motion.root_path()[-1].sub(torch.tensor([0, 1.5])).norm()) < 0.15


def test_turns_go_where_they_say():
    for name, sign in (("walk_turn_left", 1), ("walk_turn_right", -1)):
        for seed in range(4):
            facing = perform(name, seed=seed, seconds=6).motion.facing()
            turned = mk.rotations.wrap_angle(facing[1:] - facing[:-1]).sum()
            assert math.radians(50) < sign * float(turned) < math.radians(230)
    back = perform("walk_back", seed=1, seconds=5).motion.at_origin()
    assert float(back.root_path()[-1, 1]) < -1.0


def test_other_frame_rates_are_the_same_motion():
    slow, fast = (perform("kick", "angry", seed=3, seconds=5, fps=f, performer=1) for f in (30, 60))
    assert len(fast) == 2 * len(slow)
    assert float((fast.motion.positions()[::2] - slow.motion.positions()).norm(dim=-1).max()) < 0.012


def test_files_keep_a_performance(tmp_path):
    p = perform("punch", "angry", seed=1, seconds=5)
    again = mk.load(mk.save(p.motion, tmp_path / "punch.bvh"))
    order = [again.skeleton.index(n) for n in p.motion.skeleton.names]
    assert float((again.positions()[:, order] - p.motion.positions()).abs().max()) < 1e-4


@pytest.mark.parametrize(
    "arguments, message",
    [
        (dict(content="wlak"), "no content 'wlak'; did you mean 'walk'"),
        (dict(content="walk", style="tird"), "no style 'tird'; did you mean 'tired'"),
        (dict(content="walk", seconds=math.nan), "seconds"),
        (dict(content="walk", fps=0), "fps"),
        (dict(content="walk", intensity=math.inf), "intensity"),
        (dict(content="bow", seconds=1), "give more seconds"),
        (dict(content="walk, jump, kick", seconds=3), "give more seconds"),
        (dict(content="walk", path=[[0, 0], [0, math.nan]]), "path"),
        (dict(content="walk", path=[[1, 1], [1, 1]]), "same one"),
        (dict(content="walk", path="round the block"), "path"),
        (dict(content="walk", performer="crap"), "no creature 'crap'; did you mean 'crab'"),
        (dict(content=()), "no content"),
        (dict(content=None), "content: expected a name"),
        (dict(content="walk", seed="a"), "seed: expected a whole number"),
        (dict(content="walk", style=["old", "proud"]), "no style"),
        (dict(content="walk", fps=1e5), "fps: at most 1000"),
    ],
)
def test_bad_wishes_get_one_clear_error(arguments, message):
    with warnings.catch_warnings(), pytest.raises(mk.MotionKitError, match=message):
        perform(**arguments)


def test_bad_styles_get_one_clear_error():
    with pytest.raises(mk.MotionKitError, match="tempo must be a finite number"):
        Style("odd", tempo=math.nan)
    with pytest.raises(mk.MotionKitError, match="crouch is 2 legs; expected 0 to 0.35"):
        Style("odd", crouch=2)
    with pytest.raises(mk.MotionKitError, match="did you mean 'tempo'"):
        Style().replace(tempi=1.0)
    with pytest.raises(mk.MotionKitError, match="share"):
        mix({Style(): math.nan})
    with pytest.raises(mk.MotionKitError, match="only what the performer did can be told again"):
        retell(perform("walk", seed=1, seconds=3).motion, "old")
    with pytest.raises(mk.MotionKitError, match="habits: no 'foo'"):
        Performer(habits={"foo": 1.0})
    assert mix({"old": 0.5, "proud": 0.5}) == mix({get_style("old"): 0.5, get_style("proud"): 0.5})
    with pytest.raises(mk.MotionKitError, match="0.4 to 3 m tall"):
        Performer(height=12)
    with pytest.raises(mk.MotionKitError, match="not tellings of one score"):
        perform("walk", seed=1, seconds=4).time_aligned(perform("walk", seed=1, seconds=4))


def test_the_page_of_styles_agrees_with_the_code():
    page = (Path(__file__).resolve().parent.parent / "docs" / "styles.md").read_text(encoding="utf-8")
    assert page == make_styles.markdown(), "run: python tools/make_styles.py > docs/styles.md"
    assert all(f"| `{name}` |" in page for name in parameters())
    assert all(f"| {style} |" in page for style in TRAIN_STYLES + HELD_OUT_STYLES)
