"""Copying, KNN + DTW (KnnDtw) and the linear filter: against exact answers, on captures, and what they refuse."""

import pickle

import pytest
import torch
from rigs import flexion

import motionkit as mk
from motionkit import actor
from motionkit.contacts import foot_contacts, foot_sliding
from motionkit.datasets import Item, Labels
from motionkit.datasets.loading import from_items
from motionkit.datasets.performed import ActorSource
from motionkit.methods.base import Example, match_root_speed, velocity_factor
from motionkit.methods.neutral_pairs import NeutralPairs, add_pose_difference, pose_difference
from motionkit.metrics import jitter, truth_error

CONTENTS, STYLES = ("walk", "jump", "wave"), ("neutral", "old", "proud")
LEARNED = ("knn-dtw", "linear")


@pytest.fixture(scope="module")
def cache(tmp_path_factory):
    """A place for the made clips."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MOTIONKIT_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


def source(content: str, style: str, take: int) -> ActorSource:
    """Somebody does it; each time somebody else."""
    c, s = CONTENTS.index(content), STYLES.index(style)
    return ActorSource(content, style, 100 * c + 10 * s + take, (7 * take + c + s) % 60, 6.0)


def made(name: str, takes: range):
    kinds = [(c, s, t) for c in CONTENTS for s in STYLES for t in takes]
    return from_items(name, [Item(f"{c}_{s}_{t}", Labels(c, s, ()), source(c, s, t)) for c, s, t in kinds])


@pytest.fixture(scope="module")
def library(cache):
    return made("library", range(3))


@pytest.fixture(scope="module")
def test_clips(cache):
    return made("tests", range(7, 8))


@pytest.fixture(scope="module")
def learned(library):
    """The methods that learn, with the library; what they have learned serves all tests."""
    return {name: mk.methods.load(name).fit(library) for name in LEARNED}


def one(dataset, content, style):
    return dataset.filter(content=content, style=style)[0]


def performance(clip):
    return source(clip.content, clip.style, 7).perform()


def errors(method, pairs):
    """Millimetres from the exact answer and those of the content itself, the mean over pairs of clips."""
    found = []
    for content, style in pairs:
        before = performance(content)
        answer = actor.retell(before, style.style)
        result = method.stylize(content, style)
        found.append([float(truth_error(m, answer, before).mean()) for m in (result, before.motion)])
    return torch.tensor(found).mean(0).tolist()


@pytest.mark.slow
@pytest.mark.parametrize("name", LEARNED)
def test_results_are_nearer_to_the_exact_answer_than_the_content(name, learned, test_clips):
    method = learned[name]
    same = [(one(test_clips, c, "neutral"), one(test_clips, c, s)) for c in CONTENTS for s in ("old", "proud")]
    other = [
        (one(test_clips, "walk", "neutral"), one(test_clips, "jump", "old")),
        (one(test_clips, "jump", "neutral"), one(test_clips, "walk", "old")),
        (one(test_clips, "wave", "neutral"), one(test_clips, "jump", "old")),
    ]
    styled = [(one(test_clips, c, "old"), one(test_clips, d, "proud")) for c, d in (("walk", "jump"), ("jump", "wave"))]
    for pairs in (same, other, styled):
        result, content = errors(method, pairs)
        assert result < 0.6 * content


@pytest.mark.parametrize("name", LEARNED)
def test_results_are_sound(name, learned, test_clips):
    method = learned[name]
    for content, style in ((("walk", "neutral"), ("walk", "old")), (("jump", "old"), ("wave", "proud"))):
        content, style = one(test_clips, *content), one(test_clips, *style)
        out, given = method.stylize(content, style), content.motion
        assert len(out) == len(given) and out.fps == given.fps and out.skeleton is given.skeleton
        assert out.name == f"{content.name} as {style.name}"
        assert (out.root_path()[0] - given.root_path()[0]).norm() < 0.02
        assert foot_sliding(out, foot_contacts(given)) < 1.0
        assert out.positions()[..., 1].min() > given.positions()[..., 1].min() - 0.02
        assert jitter(out) < 2 * max(jitter(given), jitter(style.motion))


@pytest.mark.parametrize("name", LEARNED)
def test_strength_goes_from_the_content_to_the_style(name, learned, test_clips):
    method, content = learned[name], one(test_clips, "walk", "neutral").motion
    style = one(test_clips, "walk", "old").motion
    given = Example(style, Labels("walk"))
    out = [method.stylize(content, style=given, strength=s) for s in (0, 0.5, 1.0)]
    far = [float((m.positions() - content.positions()).norm(dim=-1).mean()) for m in out]
    assert far[0] == 0 < far[1] < far[2]


@pytest.mark.parametrize("name", LEARNED)
def test_neutral_as_neutral_stays_as_it_is(name, learned, test_clips):
    content, style = one(test_clips, "walk", "neutral"), one(test_clips, "jump", "neutral")
    out = learned[name].stylize(content, style)
    assert (out.positions() - content.motion.positions()).norm(dim=-1).mean() < 0.005


@pytest.mark.parametrize("name", LEARNED)
def test_methods_travel_to_other_processes(name, learned, test_clips):
    method = learned[name]
    content, style = one(test_clips, "walk", "old"), one(test_clips, "jump", "proud")
    here = method.stylize(content, style)
    there = pickle.loads(pickle.dumps(method)).stylize(content, style)
    assert torch.equal(here.rotations, there.rotations) and torch.equal(here.translations, there.translations)


def test_a_neutral_pair_is_neutral_and_in_step(library, learned, test_clips):
    """NeutralPairs, section 6.2: near the same walk told neutrally, though somebody else's; on the style's body."""
    method, clip = learned["knn-dtw"], one(test_clips, "walk", "old")
    pair = method.neutral_pair(clip.motion, content="walk")
    assert len(pair) == len(clip) and pair.skeleton is clip.motion.skeleton
    assert pair.name.startswith("walk_neutral") and (pair.root_path()[0] - clip.motion.root_path()[0]).norm() < 1e-3
    before = performance(clip)
    neutral = actor.retell(before, "neutral")
    found, content = (float(truth_error(m, neutral, before).mean()) for m in (pair, clip.motion))
    assert found < 0.6 * content
    own = one(library, "walk", "neutral").motion
    assert (method.neutral_pair(own, content="walk").positions() - own.positions()).norm(dim=-1).mean() < 1e-3


def test_without_labels_the_action_is_recognised(library, test_clips):
    pairs = NeutralPairs(library)
    for content in CONTENTS:
        assert pairs.pair(one(test_clips, content, "old").motion).neutral.name.startswith(content)


def test_each_clip_is_searched_for_once(library, test_clips, monkeypatch):
    pairs, searches = NeutralPairs(library), []
    search = NeutralPairs._nearest
    monkeypatch.setattr(NeutralPairs, "_nearest", lambda *a: searches.append(1) or search(*a))
    for _ in range(3):
        pairs.pair(one(test_clips, "walk", "old").motion, "walk")
        pairs.pair(one(test_clips, "walk", "proud").motion, "walk")
    assert len(searches) == 2


def test_a_difference_added_is_there(library):
    a, b = (one(library, "walk", s).motion[:100] for s in ("old", "neutral"))
    b = mk.retarget(b, a)
    there = add_pose_difference(b, pose_difference(a, b))
    assert torch.allclose(there.rotations[:, 1:].abs(), a.rotations[:, 1:].abs(), atol=1e-3)
    assert torch.allclose(there.translations[:, 0, 1], a.translations[:, 0, 1], atol=1e-4)
    assert torch.equal(there.root_path(), b.root_path())


def test_in_step_scales_the_path_as_the_movements(library):
    walk = one(library, "walk", "neutral").motion
    still = walk.rotations.mean(0).expand_as(walk.rotations)
    half = walk.replace(rotations=mk.rotations.slerp(still, walk.rotations, 0.5))
    out = match_root_speed(half, walk)
    length = lambda m: float((m.root_path()[-1] - m.root_path()[0]).norm())  # noqa: E731
    assert length(out) / length(walk) == pytest.approx(velocity_factor(half) / velocity_factor(walk), rel=1e-3)
    assert length(out) < 0.75 * length(walk)


def test_linear_takes_a_label_or_learns_from_one_clip(learned, test_clips):
    method, content = learned["linear"], one(test_clips, "walk", "neutral")
    old = one(test_clips, "walk", "old").motion
    by_label, by_clip = (
        method.stylize(content.motion, style="old"),
        method.stylize(content.motion, style=Example(old, Labels("walk"))),
    )
    before = performance(content)
    answer = actor.retell(before, "old")
    mm = [float(truth_error(m, answer, before).mean()) for m in (by_label, by_clip, content.motion)]
    assert by_label.name == f"{content.name} as old" and mm[0] < mm[1] < 0.7 * mm[2]
    with pytest.raises(mk.MotionKitError, match="has no style 'odl'; it has neutral, old, proud"):
        method.stylize(content.motion, style="odl")
    with pytest.raises(mk.MotionKitError, match="ridge must be a number from 0 up"):
        mk.methods.load("linear", ridge=float("nan"))


def test_copies_are_what_they_say(test_clips):
    content = one(test_clips, "walk", "neutral").motion.transform(1.0, (2, 0, 3))
    style = one(test_clips, "jump", "old").motion
    same = mk.methods.load("copy-content").stylize(content, style=style)
    assert torch.equal(same.rotations, content.rotations) and same.name == f"{content.name} as {style.name}"
    copied = mk.methods.load("copy-style").stylize(content, style=style.resample(60))
    assert len(copied) == len(style) and copied.fps == content.fps and copied.skeleton is content.skeleton
    assert (copied[:1].positions() - content[:1].positions())[0, 0, [0, 2]].norm() < 1e-3
    assert float((copied.facing()[0] - content.facing()[0]).abs()) < 1e-3
    bent = pose_difference(copied, style)[:, 3:-1]
    assert float(bent.abs().mean()) < 0.02  # only feet are moved a little for the other legs
    trot, sit = (mk.load(f"data/actor/dog_{d}.bvh") for d in ("trot_neutral", "sit_tired"))
    dog = mk.methods.load("copy-style").stylize(trot, style=sit)
    assert dog.skeleton is trot.skeleton and torch.equal(dog.rotations[:, 1:], sit.rotations[:, 1:])
    with pytest.raises(mk.MotionKitError, match="takes its style from a motion"):
        mk.methods.load("copy-style").stylize(content, style="old")
    with pytest.raises(mk.MotionKitError, match="content must be a Motion"):
        mk.methods.load("copy-content").stylize("walk.bvh", style=style)


def test_libraries_that_will_not_do_are_named(library, test_clips):
    with pytest.raises(mk.MotionKitError, match="has no neutral clips"):
        mk.methods.load("knn-dtw", library=library.filter(style="old"))
    with pytest.raises(mk.MotionKitError, match="give one part of a split, such as .train"):
        mk.methods.load("linear", library=library.split())
    method, walk = mk.methods.load("knn-dtw", library=library), one(test_clips, "walk", "old").motion
    with pytest.raises(mk.MotionKitError, match="knows no content 'wlak'; it has jump, walk, wave"):
        method.stylize(walk, style=Example(walk, Labels("wlak")))
    dog = mk.load("data/actor/dog_trot_neutral.bvh")
    with pytest.raises(mk.MotionKitError, match="give a library of such bodies"):
        method.stylize(dog, style=dog)
    with pytest.raises(mk.MotionKitError, match="two are the least"):
        method.neutral_pair(walk[:1])
    unknown = library.filter(content=("walk", "jump"))  # "wave" is a word of the data set, of which no clip is here
    assert NeutralPairs(unknown).pair(walk, "wave").neutral.name.startswith("walk")


@pytest.mark.captures
@pytest.mark.parametrize("name", ["copy-style", *LEARNED])
def test_captures_take_styles_from_another_rig(name, captures_dir, learned, test_clips, tmp_path):
    """A capture (other joints, rest pose, a helper joint) as old as the performer, with his library; written, read."""
    given = mk.load(sorted(captures_dir.glob("*_walk_normal_*.bvh"))[0])[:100]
    method = learned.get(name) or mk.methods.load(name)
    style = one(test_clips, "walk", "old").motion
    out = method.stylize(given, style=style)
    again = mk.load(mk.save(out, tmp_path / "out.bvh"))
    assert (again.positions() - out.positions()).abs().max() < 1e-3
    assert out.skeleton is given.skeleton and jitter(out) < 2 * max(jitter(given), jitter(style))
    assert flexion(out, "elbow").mean() > flexion(given, "elbow").mean() + 15
    assert flexion(out, "knee").mean() > flexion(given, "knee").mean() + 5


@pytest.mark.captures
@pytest.mark.parametrize("name", LEARNED)
def test_captures_with_a_library_of_captures(name, captures_dir):
    library = mk.datasets.load("bandai-2", root=captures_dir)
    content, style = one(library, "walk", "normal"), one(library, "raise-up-both-hands", "elderly")
    out = mk.methods.load(name).fit(library).stylize(content, style)
    assert jitter(out) < 2 * jitter(content.motion)
    assert foot_sliding(out, foot_contacts(content.motion)) < 1.5
