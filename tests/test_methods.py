"""Statistics transfer: known answers for the parts, and the whole on made and captured clips."""

import math

import pytest
import torch
from rigs import flexion

import motionkit as mk
from motionkit.contacts import foot_contacts, foot_sliding
from motionkit.features import FacingFree
from motionkit.methods.base import velocity_factor, warp_velocity
from motionkit.methods.baselines import match_statistics
from motionkit.metrics import jitter


@pytest.fixture(scope="module")
def clips():
    names = {"turning": "turn_left_neutral"} | {n: n for n in ("neutral", "old", "proud", "childlike")}
    return {n: mk.load(f"data/actor/walk_{file}.bvh") for n, file in names.items()}


def test_matched_features_have_the_styles_mean_and_spread():
    g = torch.Generator().manual_seed(0)
    content, style = torch.randn(100, 4, generator=g), 2 * torch.randn(80, 4, generator=g) + 5
    out = match_statistics(content, style)
    assert torch.allclose(out.mean(0), style.mean(0), atol=1e-4)
    assert torch.allclose(out.std(0, correction=0), style.std(0, correction=0), atol=1e-4)
    still = match_statistics(torch.zeros(10, 1), style[:, :1])
    assert torch.allclose(still, style[:, :1].mean().expand(10, 1))


def test_velocity_factor_of_known_motions(clips):
    assert velocity_factor(clips["neutral"][3]) == 0.0
    walk = clips["neutral"]
    frozen = walk.replace(rotations=walk.rotations[:1].expand_as(walk.rotations))
    assert velocity_factor(frozen) < 1e-4
    faster = walk.replace(fps=60.0)
    assert velocity_factor(faster) == pytest.approx(2 * velocity_factor(walk), rel=1e-4)


def test_warp_scales_the_speed_over_the_ground_only():
    x = torch.arange(12.0).reshape(2, 6)
    assert torch.equal(warp_velocity(x, 2.0), x * torch.tensor([1.0, 2, 2, 1, 1, 1]))


@pytest.mark.parametrize("style", ["old", "proud", "childlike"])
def test_restyled_walk_takes_the_style_and_keeps_the_walk(clips, style):
    content = clips["neutral"]
    out = mk.methods.load("statistics").stylize(content, style=clips[style])
    assert len(out) == len(content) and out.fps == content.fps and out.skeleton.same_tree(content.skeleton)
    layout = FacingFree()
    poses = {
        n: layout.encode(m)[:, 4:67].mean(0) for n, m in (("content", content), ("style", clips[style]), ("out", out))
    }
    assert (poses["out"] - poses["style"]).norm() < 0.35 * (poses["content"] - poses["style"]).norm()
    stands = foot_contacts(content)
    assert foot_sliding(out, stands) < 1.0
    toe = content.skeleton.index("left_foot")
    hover = (out.positions() - content.positions())[:, toe, 1][stands[:, 1]]
    assert hover.abs().max() < 0.015  # it stands on the ground, not over it
    assert out.positions()[..., 1].min() > -0.005
    assert (out.positions()[0, 0] - content.positions()[0, 0])[[0, 2]].norm() < 0.02
    bones = (out.positions()[:, 1:] - out.positions()[:, list(out.skeleton.parents[1:])]).norm(dim=-1)
    assert torch.allclose(bones, out.skeleton.offsets[1:].norm(dim=-1).expand_as(bones), atol=1e-4)


def test_strength_goes_from_the_content_to_the_style(clips):
    content, method = clips["turning"], mk.methods.load("statistics")
    out = [method.stylize(content, style=clips["old"], strength=s) for s in (0, 0.001, 0.5, 1.0)]
    far = [float((m.positions() - content.positions()).norm(dim=-1).mean()) for m in out]
    assert far[0] == 0 and far[1] < 0.005 < far[2] < far[3]


def test_style_of_another_frame_rate(clips):
    method = mk.methods.load("statistics")
    a = method.stylize(clips["neutral"], style=clips["old"])
    b = method.stylize(clips["neutral"], style=clips["old"].resample(60))
    assert (a.positions() - b.positions()).norm(dim=-1).mean() < 0.02


def test_old_walks_slower(clips):
    out = mk.methods.load("statistics").stylize(clips["neutral"], style=clips["old"])
    path = lambda m: float((m.root_path()[-1] - m.root_path()[0]).norm())  # noqa: E731
    assert path(out) < 0.7 * path(clips["neutral"])


def test_a_style_far_livelier_than_the_content_does_not_shake_it(clips):
    idle, walk = mk.load("data/actor/idle_neutral.bvh"), clips["childlike"]
    assert velocity_factor(walk) > 10 * velocity_factor(idle)
    assert jitter(mk.methods.load("statistics").stylize(idle, style=walk)) < jitter(walk)


def lean(motion: mk.Motion) -> float:
    """Degrees by which the back is bent forward, pelvis to shoulders, the mean over a clip."""
    roles, places = motion.skeleton.roles, motion.positions()
    up = (places[:, roles["left_shoulder"]] + places[:, roles["right_shoulder"]]) / 2
    up, yaw = up - places[:, motion.skeleton.pelvis], motion.facing()
    forward = up[:, 0] * torch.sin(yaw) + up[:, 2] * torch.cos(yaw)
    return float(torch.rad2deg(torch.atan2(forward, up[:, 1])).mean())


@pytest.mark.captures
def test_style_crosses_from_one_rig_to_another(captures_dir, clips):
    """The shipped old walk on a capture: other joints, names and rest pose; it bends as the retargeted style does."""
    for path in sorted(captures_dir.glob("*_walk_normal_*.bvh")):
        source = mk.load(path)
        out = mk.methods.load("statistics").stylize(source, style=clips["old"])
        wanted = mk.retarget(clips["old"], source)
        assert lean(source) < 5 and lean(out) == pytest.approx(lean(wanted), abs=2)
        for joint in ("knee", "elbow"):
            assert flexion(out, joint).mean(0).tolist() == pytest.approx(flexion(wanted, joint).mean(0).tolist(), abs=3)
        assert foot_sliding(out, foot_contacts(source)) < 1.0 and out.skeleton is source.skeleton


@pytest.mark.captures
def test_captures_get_restyled_written_and_read_back(captures_dir, tmp_path):
    method = mk.methods.load("statistics")
    for content in ("walk", "raise-up-both-hands"):
        source = mk.load(next(iter(sorted(captures_dir.glob(f"*_{content}_normal_*.bvh")))))
        for style in ("elderly", "active"):
            given = mk.load(next(iter(sorted(captures_dir.glob(f"*_{content}_{style}_*.bvh")))))
            out = method.stylize(source, style=given)
            again = mk.load(mk.save(out, tmp_path / "out.bvh"))
            assert (again.positions() - out.positions()).abs().max() < 1e-4 * out.skeleton.height
            assert again.skeleton.names == source.skeleton.names
            assert torch.equal(out.translations[:, 0], source.translations[:, 0])  # the helper root stays where it was


def test_what_cannot_be_done_is_said(clips):
    method = mk.methods.load("statistics")
    with pytest.raises(mk.MotionKitError, match="takes its style from a motion"):
        method.stylize(clips["neutral"], style="old")
    with pytest.raises(mk.MotionKitError, match="two are the least"):
        method.stylize(clips["neutral"][:1], style=clips["old"])
    names = tuple(f"j{n}" for n in range(22))
    old = clips["old"]
    unnamed = old.replace(skeleton=type(old.skeleton)(names, old.skeleton.parents, old.skeleton.offsets))
    with pytest.raises(mk.MotionKitError, match="expected hips, knees, ankles"):
        method.stylize(clips["neutral"], style=unnamed)
    with pytest.raises(mk.MotionKitError, match="retarget"):
        method.stylize(clips["neutral"], style=mk.load("data/actor/dog_trot_neutral.bvh"))
    for strength in ("1", math.nan, math.inf, None, True):
        with pytest.raises(mk.MotionKitError, match="statistics: strength must be a number"):
            method.stylize(clips["neutral"], style=old, strength=strength)
    with pytest.raises(mk.MotionKitError, match="give its .motion"):
        method.stylize(mk.actor.perform("walk", seconds=4), style=old)


def test_methods_are_loaded_by_name():
    assert [mk.methods.load(n).name for n in mk.methods.names()] == mk.methods.names()
    with pytest.raises(mk.MotionKitError, match="did you mean 'statistics'"):
        mk.methods.load("statistic")
    with pytest.raises(mk.MotionKitError, match="by its name.*several are"):
        mk.methods.load(["statistics"])
    with pytest.raises(mk.MotionKitError, match="no option 'strength'; it takes none"):
        mk.methods.load("statistics", strength=1)
    with pytest.raises(mk.MotionKitError, match="no option 'libary'; it takes library"):
        mk.methods.load("knn-dtw", libary=None)
