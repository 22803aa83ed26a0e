"""Judges: trained small on made clips, asked about bad input, and the shipped ones against their cards."""

from dataclasses import dataclass

import pytest
import torch

import motionkit as mk
from motionkit import checkpoints, judges, metrics
from motionkit.__main__ import main
from motionkit.datasets import Labels, Split, performed
from motionkit.datasets.loading import from_items
from motionkit.datasets.performed import ActorSource
from motionkit.datasets.sources import Item, Recording
from motionkit.judges import joint_features, joint_rotations, window_starts
from motionkit.layers import StGcnConfig
from motionkit.rotations import normalize, quaternion_angle
from motionkit.training import TrainConfig

KINDS = [("walk", "neutral"), ("walk", "old"), ("bow", "neutral"), ("bow", "old")]


@pytest.fixture(scope="module")
def small() -> Split:
    """Two contents in two styles, two takes to learn from and one to test on."""
    found = []
    for part, takes in (("train", (0, 1)), ("test", (2,))):
        items = [
            Item(f"{c}_{s}_{n}", Labels(c, s, (), take=f"{c} {s} {n}"), ActorSource(c, s, n, 40 + n, 5.0))
            for c, s in KINDS
            for n in takes
        ]
        found.append(from_items(f"small-{part}", items))
    return Split(found[0], found[1][:0], found[1])


@pytest.fixture(scope="module")
def judge(small) -> judges.Classifier:
    return judges.train_classifier("content", small, StGcnConfig.tiny(), TrainConfig(40, lr=1e-2), title="")


@pytest.mark.slow
def test_it_learns_and_says_what_it_has_learned(small, judge):
    assert judge.labels == ("bow", "walk") and judge.accuracy(small.train) == 100
    assert judge.card["metrics"] == {"test_accuracy": judge.accuracy(small.test)} and judge.card["seed"] == 0
    assert judge.card["licence"] == "MIT" and judge.card["training_clips"] == 8
    again = judges.train_classifier("content", small, StGcnConfig.tiny(), TrainConfig(40, lr=1e-2), title="")
    clips = [clip.motion for clip in small.test]
    assert torch.equal(again.scores(clips), judge.scores(clips))  # the seed says all of it


def test_a_motion_gets_the_mean_over_its_windows(small, judge):
    assert window_starts(64) == [0] and window_starts(65) == [0, 1] and window_starts(10) == [0]
    assert window_starts(128) == [0, 32, 64]
    motion = small.test[0].motion
    assert len(motion) == 150
    pieces = [judge.encode(motion)[n : n + 64] for n in (0, 32, 64, 86)]
    with torch.no_grad():
        alone = [judge.network(p.permute(2, 0, 1)[None]).log_softmax(1) for p in pieces]
    assert torch.allclose(judge.scores([motion]), sum(alone) / 4, atol=1e-5)
    assert judge.scores([motion[:20]]).shape == (1, 2)
    scores, features = judge.scores_and_features([motion, motion[:30], motion])
    assert torch.allclose(scores[0], scores[2], atol=1e-5) and features.shape == (3, 16)
    assert (scores.exp().sum(1) <= 1 + 1e-5).all()


def test_what_judges_see_does_not_depend_on_where_a_motion_is(small, judge):
    motion = small.test[0].motion
    there = motion.transform(2.0, (3.0, 0.0, -1.0))
    assert torch.allclose(joint_features(motion), joint_features(there), atol=1e-4)
    assert quaternion_angle(joint_rotations(motion), joint_rotations(there)).max() < 1e-3
    assert torch.allclose(judge.scores([motion]), judge.scores([there]), atol=1e-3)
    twice = motion.resample(60)
    assert (judge.scores([twice]) - judge.scores([motion])).abs().max() < 0.1


def test_joints_in_another_order_are_put_in_order(small, judge, tmp_path):
    motion = small.test[0].motion
    read = mk.load(mk.save(motion, tmp_path / "a.bvh"))
    assert read.skeleton.names != motion.skeleton.names
    assert torch.allclose(judge.scores([read]), judge.scores([motion]), atol=1e-2)
    parents = list(motion.skeleton.parents)
    parents[judge.skeleton.index("head")] = judge.skeleton.index("spine3")
    other = type(motion.skeleton)(motion.skeleton.names, tuple(parents), motion.skeleton.offsets)
    with pytest.raises(mk.MotionKitError, match="differ in the joints' parents"):
        judge.scores([motion.replace(skeleton=other)])


def test_results_that_there_are_not_get_nan_and_are_counted_as_wrong(small, judge):
    motion = small.test[0].motion
    scores, features = judge.scores_and_features([motion, None])
    assert torch.isnan(scores[1]).all() and torch.isnan(features[1]).all() and torch.isfinite(features[0]).all()
    assert metrics.recognition_accuracy(scores, judge.ids([small.test[0].content] * 2)) <= 50
    with pytest.raises(mk.MotionKitError, match="all 1 motions .* are None"):
        judge.features([None])


def test_bad_input_is_told(small, judge):
    motion = small.test[0].motion
    names = tuple(f"{name}_" if n == 4 else name for n, name in enumerate(motion.skeleton.names))
    other = motion.replace(skeleton=type(motion.skeleton)(names, motion.skeleton.parents, motion.skeleton.offsets))
    for given, message in (
        ([other], "differ in left_knee, left_knee_: retarget it"),
        (motion, "give a list"),
        ([], "no motions"),
        (["walk.bvh"], "judges motions; found 'walk.bvh'"),
        ([small.test[0]], "give its .motion"),
        ([motion[:0]], "has no frames"),
    ):
        with pytest.raises(mk.MotionKitError, match=message):
            judge.scores(given)
    with pytest.raises(mk.MotionKitError, match="knows the contents bow, walk; 'fly' is none"):
        judge.ids(["walk", "fly"])
    with pytest.raises(mk.MotionKitError, match="one content only"):
        only = small.train.filter(content="walk")
        walks = from_items("walks", [Item("a", Labels("walk", "old", ()), ActorSource("walk", "old", 1, 1, 4.0))])
        assert len(only) == 4
        judges.train_classifier("content", Split(walks, walks[:0], walks[:0]))


def test_there_and_back(small, judge, tmp_path):
    path = judge.save(tmp_path / "small-content.safetensors")
    again = judges.Classifier.load(path)
    clips = [clip.motion for clip in small.test]
    assert torch.allclose(again.scores(clips), judge.scores(clips), atol=0.02) and again.labels == judge.labels
    for name, value in judge.network.state_dict().items():
        stored = value.half().float() if value.is_floating_point() else value
        assert torch.equal(again.network.state_dict()[name], stored), name
    twice = judges.Classifier.load(again.save(path))
    assert torch.equal(twice.scores(clips), again.scores(clips))  # what is written once is exact
    with pytest.raises(mk.MotionKitError, match="expected a 'autoencoder'"):
        judges.MotionAutoencoder.load(path)


@dataclass(frozen=True)
class Reversed(ActorSource):
    """The same frames, last one first."""

    @property
    def state(self) -> str:
        return f"reversed {super().state}"

    def read(self) -> Recording:
        motion = super().read().motion
        return Recording(motion.sample(torch.arange(len(motion) - 1, -1, -1.0)))


@pytest.mark.slow
def test_a_single_frame_cannot_tell_which_way_the_film_runs():
    """Both classes have the same poses, so one pose gives away nothing at all, and movement everything."""
    parts = []
    for part, takes in (("learn", range(6)), ("unseen", range(6, 9))):
        pairs = [(n, "forwards", ActorSource) for n in takes] + [(n, "backwards", Reversed) for n in takes]
        items = [Item(f"{how}_{n}", Labels("walk", how, ()), kind("walk", "old", n, n, 4.0)) for n, how, kind in pairs]
        parts.append(from_items(part, items))
    split = Split(parts[0], parts[0][:0], parts[1])
    assert judges.single_frame_accuracy("style", split, TrainConfig(20, lr=1e-2), title="") == pytest.approx(50, abs=2)
    moving = judges.train_classifier("style", split, StGcnConfig.tiny(), TrainConfig(80, lr=1e-2), title="")
    assert moving.accuracy(split.test) == 100


@pytest.mark.slow
def test_the_autoencoder_takes_noise_away(small, tmp_path):
    made_one = judges.train_autoencoder(small, TrainConfig(150, lr=3e-3), title="")
    found = made_one.card["metrics"]
    assert (
        0 < found["test_degrees"] < 25 and 4 < found["noise_degrees"] < 7
    )  # 2 x 0.03 rad x the mean length of three such numbers
    clips = [clip.motion for clip in small.test]
    again = judges.MotionAutoencoder.load(made_one.save(tmp_path / "a.safetensors"))
    assert torch.allclose(again.features(clips), made_one.features(clips), atol=1e-3)
    twice = judges.MotionAutoencoder.load(again.save(tmp_path / "a.safetensors"))
    assert torch.equal(twice.features(clips), again.features(clips))


def test_the_denoising_loss_is_the_angle_to_the_clean_rotation():
    """Of a network that changes nothing it is the noise itself; of one that knows the answer it is 0."""
    torch.manual_seed(0)
    turns = normalize(torch.randn(4, 64, 22, 4))
    by_noise = [float(judges.denoising_loss(torch.nn.Identity(), turns, noise)) for noise in (0.0, 0.01, 0.03)]
    # the three numbers across a unit quaternion are normal: their length has the mean 2 (2 / pi)^0.5, half an angle's
    assert by_noise == pytest.approx([0.0, 0.01 * 3.1915, 0.03 * 3.1915], rel=0.02, abs=1e-3)

    class Oracle(torch.nn.Module):
        def forward(self, noisy: torch.Tensor) -> torch.Tensor:
            return -turns  # the same rotations, written with the other sign

    assert judges.denoising_loss(Oracle(), turns) < 1e-3
    net = judges.DenoisingAutoencoder(joints=22)
    assert torch.allclose(net(turns).norm(dim=-1), torch.ones(4, 64, 22), atol=1e-5)
    assert net.encode(turns[:, :37]).shape == (4, 64, 10) and net(turns[:, :37]).shape == (4, 37, 22, 4)


def test_the_command_trains_all_three_and_load_finds_them(tmp_path, monkeypatch, capsys, small):
    monkeypatch.setenv("MOTIONKIT_CHECKPOINTS", str(tmp_path))
    monkeypatch.setattr(judges, "single_frame_accuracy", lambda *_, **__: 50.0)
    whole = from_items("whole", [Item(c.name, c.labels, ActorSource(c.content, c.style, n, 40 + n, 5.0))
                               for part in (small.train, small.test) for n, c in enumerate(part)])  # fmt: skip
    monkeypatch.setattr(type(whole), "split", lambda self: small)
    monkeypatch.setattr(mk.datasets, "load", lambda name, root: whole)
    assert main(["train", "judge", "--data", "whole", "--config", "tiny", "--steps", "3"]) == 0
    written = capsys.readouterr().out.split()
    assert written == [str(tmp_path / f"whole-{part}.safetensors") for part in judges.PARTS]
    assert checkpoints.names() == ["whole-autoencoder", "whole-content", "whole-style"]
    assert not list(tmp_path.glob("*.run"))
    found = judges.load("whole")
    assert found.style.labels == ("neutral", "old") and found.content.card["steps"] == 3
    command = "python -m motionkit train content --data whole --config tiny --seed 0 --steps 3"
    assert found.content.card["command"] == command
    judges.load.cache_clear()
    (tmp_path / "whole-style.safetensors").unlink()
    with pytest.raises(mk.MotionKitError, match="no judge for 'whole'; .* python -m motionkit train judge"):
        judges.load("whole")


CARDS = {"actor": {"content": 98.0, "style": 97.0}, "bandai-2": {"content": 99.0, "style": 99.0}}


@pytest.mark.parametrize("name, label", [(name, label) for name, labels in CARDS.items() for label in labels])
def test_cards_reach_the_figures_and_say_all(name, label):
    card = getattr(judges.load(name), label).card
    assert card["metrics"]["test_accuracy"] >= CARDS[name][label]
    assert 100 / len(card["labels"]) < card["metrics"]["single_frame_accuracy"] < card["metrics"]["test_accuracy"]
    assert card["command"].startswith(f"python -m motionkit train {label} --data {name}")
    assert {"seed", "seconds", "hardware", "parameters", "data_sha256", "licence", "steps"} <= set(card)


@pytest.mark.slow
def test_the_shipped_actor_judge_keeps_its_cards_word():
    """Every second of the test clips, made anew."""
    items = [item for item in performed.items("actor") if item.labels.split == "test"][::2]
    clips = from_items("actor", items)
    judge = judges.load("actor")
    for label in ("content", "style"):
        found = getattr(judge, label).accuracy(clips)
        assert abs(found - getattr(judge, label).card["metrics"]["test_accuracy"]) < 2.0


@pytest.mark.slow
@pytest.mark.captures
def test_the_shipped_bandai_judge_keeps_its_cards_word(captures):
    clips = mk.datasets.load("bandai-2", captures).split().test
    judge = judges.load("bandai-2")
    for label in ("content", "style"):
        card = getattr(judge, label).card
        assert abs(getattr(judge, label).accuracy(clips) - card["metrics"]["test_accuracy"]) < 0.5
        assert card["licence"] == "CC-BY-NC-4.0"
    where = checkpoints.find("bandai-2-style").parent
    assert "CC BY-NC 4.0" in (where / "README.md").read_text()
    features = judge.autoencoder.features([clip.motion for clip in clips])
    assert metrics.fmd(features, features) < 1e-6
