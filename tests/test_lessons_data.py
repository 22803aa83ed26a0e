"""Pictures of style show what they are given, and the mixer's performer does what its sliders say."""

import pytest
import torch

import motionkit as mk
from motionkit import actor
from motionkit.lessons import data


@pytest.fixture(scope="module")
def walk():
    return actor.perform("walk", seed=1, seconds=4)


@pytest.fixture
def mixer():
    return mk.lessons.data.style_mixer("walk", "old", seconds=4)


def test_the_mixer_begins_as_the_retelling_does(mixer, walk):
    told = actor.retell(walk, "old")
    assert torch.equal(mixer.performance.motion.positions(), told.motion.positions())


@pytest.mark.parametrize("name", [name for group in data.STYLE_GROUPS.values() for name in group])
def test_every_slider_moves_somebody_who_walks(mixer, name):
    control, before = mixer.controls[name], mixer.player.motions[0]
    control.value = control.max if control.value < (control.min + control.max) / 2 else control.min
    assert getattr(mixer.style, name) == control.value
    after = mixer.player.motions[0]
    assert len(after) != len(before) or (after.positions() - before.positions()).abs().max() > 0.01


def test_a_foot_in_the_air_stays_there_when_the_pace_changes(mixer):
    before, frame = mixer.performance, 70
    mixer.player.frame = frame
    mixer.controls["tempo"].value = 1.5
    after = mixer.performance
    assert len(after) < 0.7 * len(before)
    beat = float(after.beats[mixer.player.frame])
    assert beat == pytest.approx(float(before.beats[frame]), abs=0.05)


def test_choosing_a_style_moves_all_sliders_and_performs_once(mixer, monkeypatch):
    told = []
    monkeypatch.setattr(data, "retell", lambda *args: told.append(args) or actor.retell(*args))
    mixer.controls["intensity"].value = 0.5
    mixer.controls["style"].value = "robot"
    assert mixer.controls["intensity"].value == 1.0
    assert mixer.controls["elbow_bend"].value == actor.get_style("robot").elbow_bend
    assert mixer.style.values() == actor.get_style("robot").values()
    assert len(told) == 2


def test_intensity_strengthens_numbers_without_a_slider_too(mixer):
    mixer.controls["intensity"].value = 0.5
    assert mixer.style.tremor == pytest.approx(0.5 * actor.get_style("old").tremor)


def test_the_mixer_leaves_a_still(mixer):
    assert mixer.still().startswith(b"\x89PNG")
    assert mixer._repr_mimebundle_()["image/png"]


def test_an_unknown_start_names_the_nearest():
    with pytest.raises(mk.MotionKitError, match="did you mean 'proud'"):
        mk.lessons.data.style_mixer("walk", "prowd")
    with pytest.raises(mk.MotionKitError, match="style is a name"):
        mk.lessons.data.style_mixer("walk", actor.Style())


def test_gait_angles_tell_old_from_neutral(walk):
    plain, old = (data.gait_angles(p) for p in (walk, actor.retell(walk, "old")))
    assert old["trunk lean (°)"].mean() > plain["trunk lean (°)"].mean() + 20
    assert old["left elbow (°)"].mean() > plain["left elbow (°)"].mean() + 20
    assert old["head height (m)"].mean() < plain["head height (m)"].mean() - 0.1


def test_cycle_mean_is_a_mean_over_each_part_of_the_cycle():
    phase = (torch.arange(200) + 0.5) / 50 % 1
    found = data.cycle_mean(torch.sin(2 * torch.pi * phase), phase, 10)
    middle = torch.sin(2 * torch.pi * (torch.arange(10) + 0.5) / 10)
    assert torch.allclose(found, middle, atol=0.03)
    assert data.cycle_mean(torch.ones(1), torch.tensor([0.1]), 2).isnan().tolist() == [False, True]


def test_every_performance_has_a_curve_in_every_panel(walk):
    picture = mk.lessons.data.plot_phase({"neutral": walk, "old": actor.retell(walk, "old")})
    assert [len(ax.lines) for ax in picture.axes] == [2, 2, 2, 2]


def test_discs_are_as_large_as_the_errors(walk):
    errors = torch.arange(22.0)
    picture = mk.lessons.data.plot_joint_errors(walk.motion[:1], {"a": errors})
    radii = [p.radius for p in picture.axes[0].patches if hasattr(p, "radius")]
    assert torch.allclose(torch.tensor(radii) * 1000, errors)
    with pytest.raises(mk.MotionKitError, match="3 errors"):
        mk.lessons.data.plot_joint_errors(walk.motion[:1], {"a": errors[:3]})


def test_bands_of_a_standing_body_lie_below_those_of_walks(walk):
    still = [actor.perform("idle", seed=n, seconds=4).motion for n in range(2)]
    picture = mk.lessons.data.plot_speed_bands([walk.motion, walk.motion], still, {"pelvis": "pelvis"})
    (ax,) = picture.axes
    mean = ax.lines[0].get_ydata()[0]
    assert mean < 0.2 * ax.patches[0].get_y()
