"""Paper 1's ablations: the rows of table 3 as one call each, the autoencoder, figure 8's sweeps of G and K; and the
bound of held-back styles."""

import pickle
from dataclasses import replace

import pytest
import torch

import motionkit as mk
from motionkit.benchmarks import few_shot as benchmark
from motionkit.benchmarks.few_shot import (
    ABLATIONS,
    Autoencoder,
    ConvAutoencoder,
    Direct,
    GroundTruthCode,
    ablation,
    sweep_g,
    sweep_k,
    with_autoencoder,
)
from motionkit.datasets import BvhSource, Item, Labels
from motionkit.datasets.loading import from_items
from motionkit.methods.few_shot import Config, FewShot

QUICK = Config(steps=2, batch=1, pair_steps=4)
WALKS = Labels(texts=("a person is walking",))


def clip(name, content, style, *texts):
    path = f"data/actor/{name}.bvh"
    return Item(name, Labels(content, style, texts), BvhSource.at(path))


@pytest.fixture(scope="module")
def library():
    walks = {"neutral": "a person is walking", "old": "an old person is walking"}
    return from_items("mine", [clip(f"walk_{style}", "walk", style, text) for style, text in walks.items()])


@pytest.fixture(scope="module")
def method(library):
    return mk.methods.load("few-shot", library=library, config=QUICK)


def test_rows_of_table_3_differ_in_their_part_alone(library):
    assert list(ABLATIONS) == ["ours", "with KNN + DTW", "with AE", "without L_s"]
    rows = {row: ablation(row, library=library) for row in ABLATIONS}
    ours = rows["ours"].config
    assert ours == Config.laptop() and type(rows["ours"]) is FewShot
    assert rows["with KNN + DTW"].config == replace(ours, pair="knn-dtw")
    assert rows["with AE"].config == ours and type(rows["with AE"]) is Autoencoder
    assert rows["without L_s"].config == replace(ours, loss_weights=(1.0, 0.0))
    with pytest.raises(mk.MotionKitError, match="a config has no 'model'"):
        Config().changed(model="gan")


@pytest.mark.slow
def test_the_autoencoder_learns_to_give_motions_back(method, library, monkeypatch):
    monkeypatch.setattr(benchmark, "_AE_BATCH", 4)
    prior = with_autoencoder(method.prior, library, steps=60, title="")
    x = method.prior.encode(library[0].motion)
    fresh = ConvAutoencoder(x.shape[1])
    with torch.no_grad():
        before, after = (float(((network(x[None]) - x) ** 2).mean()) for network in (fresh, prior.network))
    assert after < 0.3 * before
    assert prior.network(x[None, :37]).shape == (1, 37, x.shape[1])
    assert torch.equal(prior.network(x[None], torch.tensor([5]), torch.zeros(1, 128)), prior.network(x[None]))
    with pytest.raises(mk.MotionKitError, match="no clip of the library has 64 frames"):
        with_autoencoder(method.prior, library[:0], steps=1)


def test_the_autoencoder_in_the_denoisers_place(method, library, monkeypatch, tmp_path):
    monkeypatch.setattr(benchmark.with_autoencoder, "__defaults__", (3, 0))
    autoencoder = Autoencoder(library=library, config=QUICK)
    assert isinstance(autoencoder.partial, Direct) and isinstance(autoencoder.model.network, ConvAutoencoder)
    walk = library[0].motion
    style = autoencoder.learn(library[1].motion, library[1].text, title="")
    out = autoencoder.stylize(walk, style, labels=WALKS)
    assert len(out) == len(walk) and bool(out.positions().isfinite().all())
    with pytest.raises(mk.MotionKitError, match="learned with another prior"):
        method.stylize(walk, style)
    with pytest.raises(mk.MotionKitError, match="an autoencoder's style is not kept"):
        style.save(tmp_path / "old.safetensors")
    again = pickle.loads(pickle.dumps(autoencoder))
    assert "model" not in vars(again) and again.clips is None  # it learns anew, from the same clips


def test_an_autoencoder_may_learn_from_other_clips(method, library, monkeypatch):
    monkeypatch.setattr(benchmark.with_autoencoder, "__defaults__", (3, 0))
    theirs, own = (ablation("with AE", library=library, clips=clips) for clips in (library[1:], None))
    assert theirs.model.key != own.model.key and theirs.fit(library).clips is not None


def test_direct_is_one_call_without_noise():
    x = torch.randn(2, 5, 3)
    assert Direct().forward(None, x) is x
    predictions = Direct().reverse(lambda y, t: y + t[:, None, None], x)
    assert torch.equal(predictions, x[None])


@pytest.mark.slow
def test_sweeps_have_figure_8s_ends(method, library):
    """With little noise feet agree and the pair is not yet neutral; small K keeps the content's feet."""
    old, walk = library[1], library[0]
    rows = sweep_g(method.with_config(pair_steps=20), [old], (200, 950))
    assert [row["g"] for row in rows] == [200, 950]
    assert rows[0]["fca"] > rows[1]["fca"] and rows[0]["similarity"] < rows[1]["similarity"]
    rows = sweep_k(method, [old], [walk], (100, 300))
    assert [row["k"] for row in rows] == [100, 300] and all(80 < row["fca"] <= 100 for row in rows)
    for sweep in (lambda: sweep_g(method, []), lambda: sweep_k(method, [old], [])):
        with pytest.raises(mk.MotionKitError, match="a sweep needs (examples|contents), clips with captions; found no"):
            sweep()


def test_sweeps_refuse_clips_without_captions(method):
    mute = from_items("mute", [clip("walk_old", "walk", "old")])
    with pytest.raises(mk.MotionKitError, match="'walk_old' without one"):
        sweep_g(method, list(mute))


def test_the_bound_of_held_back_styles_has_the_performers_own_code():
    walk, old = (mk.load(f"data/actor/walk_{style}.bvh") for style in ("neutral", "old"))
    method, example = GroundTruthCode(), mk.methods.Example(old, Labels("walk", "zombie"))
    (code,) = method.read_style(example)
    assert code.style().values() == pytest.approx(mk.actor.get_style("zombie").values(), abs=1e-5)
    assert len(method.stylize(walk, example, labels=WALKS)) == len(walk)
