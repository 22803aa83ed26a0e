"""Streams: what whole clips give, one frame at a time; labels and wishes that change; frames that are broken."""

import numpy as np
import pytest
import torch
from style_erd_small import CONTENTS, STYLES, small_model

import motionkit as mk
from motionkit.actor import perform
from motionkit.features.style_erd import frames_of, motion_from, split
from motionkit.methods.style_erd import ErdModel
from motionkit.methods.style_erd_labels import FrameClassifier, LabelTracker
from motionkit.methods.style_erd_stream import ErdStream

PLAIN = {"content": "walk", "own_style": "neutral"}


@pytest.fixture(scope="module")
def walk():
    return perform("walk", "neutral", seed=2, seconds=2.0).motion


@pytest.fixture(scope="module", params=[False, True], ids=["paper", "input residual"])
def model(request):
    return small_model(input_residual=request.param)


def whole(model, motion, wanted, content="walk", own="neutral"):
    """The clip at once, by the network itself."""
    seen, labels = frames_of(motion), (torch.tensor([CONTENTS.index(content)]), torch.tensor([STYLES.index(own)]))
    with torch.no_grad():
        y = model.network(seen.x[None], *labels, torch.as_tensor(wanted)[None])[0][0]
    return motion_from(motion, seen, *split(y))


def run(stream, motion):
    return torch.cat(
        [stream(motion[n : n + 1]).positions() for n in range(len(motion))]
    )  # fmt: skip


def test_one_frame_at_a_time_is_the_clip_at_once(model, walk):
    stream = ErdStream(model, "old", **PLAIN)
    assert float((run(stream, walk) - whole(model, walk, model.style_weights("old")).positions()).abs().max()) < 1e-4


def test_many_streams_do_not_disturb_each_other(model, walk):
    other = perform("walk", "proud", seed=5, seconds=2.0, performer=9).motion
    labels = {"content": ["walk", "jump"], "own_style": ["neutral", "proud"]}
    stream = ErdStream(model, ["old", {"proud": 0.5}], [1.0, 1.5], **labels, count=2)
    made = [stream([walk[n : n + 1], other[n : n + 1]]) for n in range(60)]
    wholes = (
        whole(model, walk, model.style_weights("old")),
        whole(model, other, model.style_weights({"proud": 0.75}), "jump", "proud"),
    )
    for k, wanted in enumerate(wholes):
        assert float((torch.cat([pair[k].positions() for pair in made]) - wanted.positions()).abs().max()) < 1e-4


def test_wishes_may_change_at_any_frame(model, walk):
    stream, made = ErdStream(model, "old", **PLAIN, fade=0), []
    for n in range(60):
        if n == 20:
            stream.style = {"old": 0.5, "proud": 0.5}
        if n == 40:
            stream.style, stream.strength = "proud", 0.25
        made.append(stream(walk[n : n + 1]).positions())
    wanted = np.concatenate([np.tile(model.style_weights(one), (20, 1)) for one in
                             ("old", {"old": 0.5, "proud": 0.5}, {"proud": 0.25})])  # fmt: skip
    assert float((torch.cat(made) - whole(model, walk, wanted).positions()).abs().max()) < 1e-4


def test_a_dial_beyond_its_ends_is_marked(model):
    stream = ErdStream(model, "old", **PLAIN)
    assert not stream.extrapolated and model.label_id("style", "normal") == model.label_id("style", "neutral") == 0
    for style, strength, beyond in (("old", 1.5, True), ("old", -0.2, True), ({"old": 0.7, "proud": 0.3}, 1, False),
                                    ({"old": 0.7, "proud": 0.7}, 1, True), ("neutral", 3.0, False)):  # fmt: skip
        stream.style, stream.strength = style, strength
        assert stream.extrapolated is beyond, (style, strength)


def test_broken_frames_are_held_and_leave_no_trace(model, walk):
    stream = ErdStream(model, "old", **PLAIN)
    fine = torch.cat([stream(walk[n : n + 1]).positions() for n in range(60)])
    stream, made, held = ErdStream(model, "old", **PLAIN), [], []
    for n in range(60):
        frame = walk[n : n + 1]
        if 20 <= n < 23:
            turns = frame.rotations.clone()
            turns[0, 5] = float("nan")
            object.__setattr__(frame, "rotations", turns)  # a Motion refuses such numbers; a live source does not ask
        made.append(stream(frame).positions())
        held.append(int(stream.held[0]))
    assert held[19:25] == [0, 1, 2, 3, 0, 0]
    made = torch.cat(made)
    assert bool(made.isfinite().all()) and float((made[50:] - fine[50:]).diff(dim=0).abs().max()) < 0.02
    speed = made.diff(dim=0).norm(dim=-1).amax(1)
    assert float(speed[22]) < 6 * float(fine.diff(dim=0).norm(dim=-1).amax(1).max())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda m: m.resample(60)[:1], "takes 30 frames a second; found 60"),
        (lambda m: m[:2], "one frame at a time"),
        (lambda m: "frame", "one frame at a time"),
        (lambda m: mk.load("data/actor/dog_trot_neutral.bvh")[:1], "another skeleton"),
        (lambda m: mk.load("data/actor/walk_old.bvh")[:1], r"joints in another order \(first at"),
    ],
)
def test_other_frames_midway_are_refused_and_the_stream_goes_on(model, walk, change, message):
    stream = ErdStream(model, "old", **PLAIN)
    before = [stream(walk[n : n + 1]) for n in range(5)]
    with pytest.raises(mk.MotionKitError, match=message):
        stream(change(walk))
    again = ErdStream(model, "old", **PLAIN)
    wanted = [again(walk[n : n + 1]) for n in range(6)]
    assert torch.equal(stream(walk[5:6]).rotations, wanted[5].rotations) and len(before) == 5


def test_unknown_names_and_numbers_change_nothing(model, walk):
    stream = ErdStream(model, "old", **PLAIN)
    for wrong, message in (("odl", "did you mean 'old'"), ({"old": float("nan")}, "must be a number")):
        with pytest.raises(mk.MotionKitError, match=message):
            stream.style = wrong
    for wrong in (5, None, walk):
        with pytest.raises(mk.MotionKitError, match="takes a style by a name, or a mix"):
            stream.style = wrong
    with pytest.raises(mk.MotionKitError, match="must be a number .* found 'a'"):
        ErdStream(model, "old", "a", **PLAIN)
    with pytest.raises(mk.MotionKitError, match="must be a number .* found 'x'"):
        stream.strength = "x"
    for wrong in (["old", "proud"], ["old"] * 3):
        with pytest.raises(mk.MotionKitError, match="one for each of 1 streams; .*a mix of styles is"):
            stream.style = wrong
    for wrong in ({"count": 0}, {"count": "two"}, {"fade": -1}, {"fade": "x"}):
        with pytest.raises(mk.MotionKitError, match="streams run side by side|seconds a style takes"):
            ErdStream(model, "old", **{**PLAIN, **wrong})
    for wrong in (None, 3):
        with pytest.raises(mk.MotionKitError, match="one frame at a time"):
            stream(wrong)
    with pytest.raises(mk.MotionKitError, match="from -5 to 5, 1 for all of the style; found 50"):
        stream.style = {"old": 50, "proud": 50}
    with pytest.raises(mk.MotionKitError, match="knows no content 'swim'"):
        stream.content = "swim"
    with pytest.raises(mk.MotionKitError, match="2 frames at a time; found 1|takes 2"):
        ErdStream(model, "old", **PLAIN, count=2)(walk[:1])
    assert (stream.style, stream.strength, stream.content) == ("old", 1.0, "walk")
    assert torch.equal(stream(walk[:1]).rotations, ErdStream(model, "old", **PLAIN)(walk[:1]).rotations)


def test_a_model_is_kept_with_its_labels(model, walk, tmp_path):
    again = ErdModel.load(model.save(tmp_path / "erd.safetensors"))
    assert (again.contents, again.styles, again.fps) == (CONTENTS, STYLES, 30.0)
    assert again.network.config == model.network.config and again.skeleton.same_tree(model.skeleton)
    same = ErdModel.load(again.save(tmp_path / "again.safetensors"))
    a, b, c = (ErdStream(one, "old", **PLAIN)(walk[:1]).rotations for one in (model, again, same))
    assert torch.allclose(a, b, atol=1e-3) and torch.equal(b, c)  # weights have 16 bits on disk


def test_labels_that_nobody_says_are_guessed(model, walk, tmp_path):
    with pytest.raises(mk.MotionKitError, match="guesses no labels; say the content of what comes in: walk, jump"):
        ErdStream(model, "old")
    torch.manual_seed(1)
    labeller = FrameClassifier(22, len(CONTENTS), len(STYLES)).eval()
    with torch.no_grad():  # whatever comes in, it says proud
        labeller.style.bias[2] += 9
    knowing = ErdModel(model.network, CONTENTS, STYLES, model.skeleton, 30.0, labeller)
    knowing = ErdModel.load(knowing.save(tmp_path / "erd.safetensors"))
    stream = ErdStream(knowing, "old")
    guesses = LabelTracker(labeller)
    for n, x in enumerate(frames_of(walk).x.numpy()):
        stream(walk[n : n + 1])
        guesses.update(x[None])
        assert stream.labels == [(CONTENTS[int(guesses.content[0])], "proud")]
    stream.own_style = "neutral"
    stream(walk[:1])
    assert stream.labels[0][1] == "neutral"


def given(stream, wishes):
    """The shares that each frame gets while a wish is set before every one."""
    shares = []
    for wish in wishes:
        if wish is not None:
            stream.style = wish
        shares.append(stream._followed(stream._wanted[None])[0, 0].copy())
    return np.stack(shares)


def test_a_style_follows_the_wish_gently(model):
    stream = ErdStream(model, "old", **PLAIN, fade=0.5)
    shares = given(stream, [None] * 10 + ["proud"] + [None] * 4 + ["neutral"] + [None] * 24)
    assert np.allclose(shares.sum(1), 1, atol=1e-5) and np.abs(np.diff(shares, axis=0)).max() < 0.15
    assert np.allclose(shares[:10], model.style_weights("old")) and 0.9 < shares[10, 1] < 1  # it sets out slowly
    assert shares[14, 2] > 0.05 and np.allclose(shares[-8:], model.style_weights("neutral"), atol=0.03)
    stream = ErdStream(model, "old", **PLAIN, fade=0)
    assert np.allclose(given(stream, [None, "proud"])[1], model.style_weights("proud"))


def test_a_dial_that_is_turned_all_the_time_is_followed_all_the_time(model):
    turning = [{"old": 1 - n / 60, "proud": n / 60} for n in range(61)]
    shares = given(ErdStream(model, "old", **PLAIN, fade=0.5), turning)[:, 2]
    assert (np.diff(shares) >= 0).all() and (shares[15:] > np.arange(15, 61) / 60 - 0.16).all()
