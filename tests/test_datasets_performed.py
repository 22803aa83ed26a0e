"""The data sets that the performer makes: what is in them, and that every machine makes the same."""

import json
import pickle
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
import torch

import motionkit as mk
from motionkit import actor
from motionkit.actor import CONTENTS, Performer, retell
from motionkit.actor.performing import CREATURES, get_creature
from motionkit.actor.score import GESTURES
from motionkit.actor.style import HELD_OUT_STYLES, TRAIN_STYLES, get_style
from motionkit.datasets import performed

PARTS = ("train", "validation", "test")
FINGERPRINT = json.loads((Path(__file__).parent / "made_fingerprint.json").read_text())
ALL = {name: performed.items(name) for name in performed.TAKES}
EVERY = [item for items in ALL.values() for item in items]


def part_of(name: str, part: str) -> list:
    """The clips of a data set in a part."""
    return [item for item in ALL[name] if item.labels.split == part]


@pytest.mark.parametrize(
    ("name", "styles", "shares"),
    [
        ("actor", TRAIN_STYLES, (12, 2, 3)),
        ("actor-unseen", HELD_OUT_STYLES, (2, 1, 5)),
        ("actor-held-back", ("neutral", *HELD_OUT_STYLES), (12, 2, 3)),
    ],
)
def test_every_content_in_every_style_in_every_part(name, styles, shares):
    for part, count in zip(PARTS, shares):
        found = Counter(item.labels[:2] for item in part_of(name, part))
        assert found == {(content, style): count for content in CONTENTS for style in styles}
    assert len(ALL["actor"]) == 1632 and len(ALL["actor-unseen"]) == 384


def test_creatures_do_all_they_can():
    for part, count in zip(PARTS, (3, 1, 1)):
        found = Counter((item.source.creature, *item.labels[:2]) for item in part_of("creatures", part))
        kinds = [(name, content) for name in CREATURES for content in get_creature(name).contents]
        assert found == {(*kind, style): count for kind in kinds for style in TRAIN_STYLES}


def test_who_is_tested_on_was_never_trained_on():
    for names in (("actor", "actor-unseen", "actor-held-back"), ("creatures",)):
        people = [{i.labels.performer for n in names for i in part_of(n, part)} for part in PARTS]
        assert not people[0] & people[1] | people[0] & people[2] | people[1] & people[2]
    train, validation, test = ({i.labels.performer for i in part_of("actor", part)} for part in PARTS)
    assert (len(train), len(validation), len(test)) == (44, 6, 10)


def test_performers_do_not_give_the_style_away():
    for part in PARTS:
        people = {i.labels.performer for i in part_of("actor", part)}
        for style in TRAIN_STYLES:
            assert len({i.labels.performer for i in part_of("actor", part) if i.labels.style == style}) == len(people)
        counts = Counter(i.labels.performer for i in part_of("actor", part))
        assert max(counts.values()) <= min(counts.values()) + 4


def test_no_take_is_in_two_styles():
    takes = Counter((i.source.creature, i.labels.content, i.source.seed, i.source.performer) for i in EVERY)
    assert max(takes.values()) == 1
    assert len({(name, item.labels.take) for name, items in ALL.items() for item in items}) == len(EVERY)
    assert len({i.source.state for i in EVERY}) == len(EVERY)
    assert all(item.labels.take == item.name for item in EVERY)


def test_names_are_in_order_and_texts_tell_them():
    for name, items in ALL.items():
        names = [item.name for item in items]
        assert names == sorted(names) and len(set(names)) == len(names), name
    assert all(len(set(item.labels.texts)) == 4 for item in EVERY)
    assert next(i for i in EVERY if i.name == "run_depressed_03").labels.texts[0] == "a person is running in depression"
    dog = next(i for i in EVERY if i.name == "dog_sit_old_00")
    assert dog.labels.texts[0] == "a dog is sitting down in old age"


def test_four_to_eight_seconds_in_whole_frames():
    for item in EVERY:
        frames = item.source.seconds * performed.FPS
        assert abs(frames - round(frames)) < 1e-6 and 120 <= frames <= 240
    mean = sum(item.source.seconds for item in ALL["actor"]) / len(ALL["actor"])
    assert 5.5 < mean < 6.5


@pytest.mark.parametrize("content", [c for c in GESTURES if c != "idle"])
def test_the_slowest_do_a_whole_gesture(content):
    def rate(item):
        who = Performer.from_seed(item.source.performer)
        return who.as_done_by(get_style(item.labels.style)).tempo * who.leg**-0.5

    clips = [i for i in ALL["actor"] + ALL["actor-unseen"] if i.labels.content == content]
    for item in sorted(clips, key=rate)[:4]:
        performance = item.source.perform()
        whole = [act for act in performance.score.acts if act.name == content]
        assert len(performance) <= 240 and whole, item.name
        assert all(act.start >= performance.beats[0] and act.stop <= performance.beats[-1] + 0.1 for act in whole)


@pytest.mark.parametrize("creature", CREATURES)
def test_slow_creatures_do_a_whole_deed(creature):
    for item in (i for i in ALL["creatures"] if i.source.creature == creature and i.name.endswith("tired_04")):
        performance = item.source.perform()
        assert any(act.name == item.labels.content for act in performance.score.acts), item.name
        assert 120 <= len(performance) <= 240


def test_a_clip_is_what_the_performer_makes():
    item = next(i for i in EVERY if i.name == "kick_proud_02")
    recording, performance = item.source.read(), item.source.perform()
    frames = len(performance)
    assert frames == round(item.source.seconds * 30) and recording.motion.fps == 30
    torch.testing.assert_close(recording.motion.positions(), performance.motion.positions(), rtol=0, atol=0)
    assert {name: tuple(track.shape) for name, track in recording.tracks.items()} == {
        "contacts": (frames, 4), "phase": (frames, 1), "beats": (frames, 1)
    }  # fmt: skip
    assert torch.equal(recording.tracks["contacts"], performance.contacts)
    assert (performance.performer, performance.style.name) == (Performer.from_seed(item.source.performer), "proud")
    assert retell(performance, "old").score is performance.score
    again = pickle.loads(pickle.dumps(item.source))
    assert again == item.source and again.state == item.source.state


def test_exact_places_are_those_of_the_clip():
    for name in ("walk_old_01", "dog_walk_old_01"):
        source = next(i for i in EVERY if i.name == name).source
        exact = source.positions()
        assert exact.dtype == torch.float64
        torch.testing.assert_close(exact.float(), source.read().motion.positions(), rtol=0, atol=2e-5)


def test_as_a_dataset(tmp_path, monkeypatch):
    monkeypatch.setenv("MOTIONKIT_CACHE", str(tmp_path))
    chosen = ALL["actor"][::160] + ALL["creatures"][::400]
    ds = mk.datasets.from_items("some", chosen)
    clip = ds.filter(content=chosen[3].labels.content)[0]
    source = next(i.source for i in chosen if i.name == clip.name)
    assert torch.equal(clip.contacts, source.perform().contacts)
    torch.testing.assert_close(clip.phase[:, 0], source.perform().phase.float())
    people = mk.datasets.from_items("people", ALL["actor"][::100])
    batch = next(iter(mk.datasets.batches(people.windows(64), 4)))
    assert batch.contacts.shape == (4, 64, 4) and batch.phase.shape == (4, 64, 1)
    parts = people.split()
    assert [{c.split for c in part} <= {name} for part, name in zip(parts, PARTS)] == [True] * 3


def test_a_changed_performer_reads_no_old_cache(monkeypatch):
    source = ALL["actor"][0].source
    state = source.state
    monkeypatch.setattr(actor, "VERSION", actor.VERSION + 1)
    assert source.state != state


def test_bad_input():
    with pytest.raises(mk.MotionKitError, match="'actor' is made here, not read; leave root='data' out"):
        performed.items("actor", "data")
    with pytest.raises(mk.MotionKitError, match="give more seconds"):
        replace(next(i.source for i in EVERY if i.name == "wave_tired_00"), seconds=2.0).read()


def test_fingerprint_counts_tenths_of_millimetres():
    still = torch.full((30, 2, 3), 1.00003, dtype=torch.float64)
    told, margin = performed.fingerprint(still)
    assert margin == pytest.approx(2e-5)
    assert performed.fingerprint(still + 1.5e-5)[0] == told != performed.fingerprint(still + 2.5e-5)[0]
    still[15] += 1  # a frame that does not count, unless asked for
    assert performed.fingerprint(still)[0] == told != performed.fingerprint(still, 5)[0]


@pytest.mark.slow
@pytest.mark.parametrize("name", performed.TAKES)
def test_every_machine_makes_the_same(name):
    clips, by_name = FINGERPRINT["clips"][name], {item.name: item for item in ALL[name]}
    shown = [by_name[clip].labels for clip in clips]
    assert {x.content for x in shown} == {i.labels.content for i in ALL[name]}
    assert {x.style for x in shown} == {i.labels.style for i in ALL[name]}
    changed = []
    for clip, (first, told) in clips.items():
        if performed.fingerprint(by_name[clip].source.positions(), first)[0] != told:
            changed.append(clip)
    assert not changed, f"the performer was changed? then run {FINGERPRINT['command']}"

    assert FINGERPRINT["version"] == actor.VERSION


@pytest.mark.nightly
def test_all_can_be_made():
    for item in EVERY:
        assert len(item.source.read().motion) == round(item.source.seconds * 30), item.name
