"""Paper 1's ablations: the rows of table 3 as one call each, and figure 8's sweeps of G and K."""

import pickle

import pytest
import torch

import motionkit as mk
from motionkit.actor import perform
from motionkit.datasets import BvhSource, Item, Labels
from motionkit.datasets.loading import from_items
from motionkit.methods import few_shot as ae
from motionkit.methods.few_shot import (
    ABLATIONS,
    ConvAutoencoder,
    Direct,
    Recipe,
    sweep_change,
    sweep_noise,
    with_autoencoder,
)

QUICK = {"steps": 2, "batch": 1, "pair_steps": 4}


def clip(name, content, style, *texts):
    path = f"data/actor/{name}.bvh"
    return Item(name, Labels(content, style, texts), BvhSource.at(path))


@pytest.fixture(scope="module")
def library():
    return from_items(
        "mine",
        [
            clip("walk_neutral", "walk", "neutral", "a person is walking"),
            clip("walk_old", "walk", "old", "an old person is walking"),
        ],
    )


@pytest.fixture(scope="module")
def method(library):
    return mk.methods.load("few-shot", library=library, recipe=Recipe(**QUICK))


def test_rows_of_table_3_differ_in_their_part_alone():
    ours = ABLATIONS["ours"]
    assert list(ABLATIONS) == ["ours", "with KNN + DTW", "with AE", "without L_s"]
    assert ABLATIONS["with KNN + DTW"] == Recipe(**{**vars(ours), "pair": "knn-dtw"})
    assert ABLATIONS["with AE"] == Recipe(**{**vars(ours), "model": "autoencoder"})
    assert ABLATIONS["without L_s"] == Recipe(**{**vars(ours), "weights": (1.0, 0.0)})
    with pytest.raises(mk.MotionKitError, match="a recipe's model is 'diffusion' or 'autoencoder'"):
        Recipe(model="gan")


def test_the_autoencoder_learns_to_give_motions_back(method, library, monkeypatch):
    monkeypatch.setattr(ae, "_AE_BATCH", 4)
    prior = with_autoencoder(method.prior, library, steps=60, title="")
    x = method.prior.encode(library[0].motion)
    fresh = ConvAutoencoder(x.shape[1])
    with torch.no_grad():
        before, after = (float(((net(x[None]) - x) ** 2).mean()) for net in (fresh, prior.network))
    assert after < 0.3 * before
    assert prior.network(x[None, :37]).shape == (1, 37, x.shape[1])
    assert torch.equal(prior.network(x[None], torch.tensor([5]), torch.zeros(1, 128)), prior.network(x[None]))
    with pytest.raises(mk.MotionKitError, match="no clip of the library has 64 frames"):
        with_autoencoder(method.prior, library[:0], steps=1)


def test_the_autoencoder_in_the_denoisers_place(method, library, monkeypatch, tmp_path):
    monkeypatch.setattr(ae.with_autoencoder, "__defaults__", (3, 0))
    own = method.with_recipe(model="autoencoder")
    assert isinstance(own.chain, Direct) and isinstance(own.model.network, ConvAutoencoder)
    walk = library[0].motion
    learned = own.learn(library[1].motion, library[1].text, title="")
    out = own.stylize(walk, learned, caption="a person is walking")
    assert len(out) == len(walk) and bool(out.positions().isfinite().all())
    with pytest.raises(mk.MotionKitError, match="learned with another prior"):
        method.stylize(walk, learned)
    with pytest.raises(mk.MotionKitError, match="an autoencoder's style is not kept"):
        learned.save(tmp_path / "old.safetensors")


def test_direct_is_one_call_without_noise():
    x = torch.randn(2, 5, 3)
    assert Direct().forward(None, x) is x
    seen = Direct().reverse(lambda y, t: y + t[:, None, None], x)
    assert torch.equal(seen, x[None])


def test_having_keeps_all_but_the_recipe(method):
    own = method.with_recipe(change=200)
    assert (own.recipe.change, own.prior, own.pairs) == (200, method.prior, method.pairs)
    assert own.chain.stops != method.chain.stops
    again = pickle.loads(pickle.dumps(method))
    assert again.recipe == method.recipe and again.last is None and "pairs" not in vars(again)


def test_sweeps_have_figure_8s_ends(method, library):
    """With little noise feet agree and the pair is not yet neutral; small K keeps the content's feet."""
    old, walk = library[1], library[0]
    rows = sweep_noise(method.with_recipe(pair_steps=20), [old], (200, 950))
    assert [row["g"] for row in rows] == [200, 950]
    assert rows[0]["fca"] > rows[1]["fca"] and rows[0]["similarity"] < rows[1]["similarity"]
    rows = sweep_change(method, [old], [walk], (100, 300))
    assert [row["k"] for row in rows] == [100, 300] and all(80 < row["fca"] <= 100 for row in rows)
    for sweep in (lambda: sweep_noise(method, []), lambda: sweep_change(method, [old], [])):
        with pytest.raises(mk.MotionKitError, match="a sweep needs (examples|contents), clips with captions; found no"):
            sweep()


def test_sweeps_refuse_clips_without_captions(method):
    mute = from_items("mute", [clip("walk_old", "walk", "old")])
    with pytest.raises(mk.MotionKitError, match="'walk_old' without one"):
        sweep_noise(method, list(mute))


def test_a_new_recipe_restyles_a_performed_clip(method):
    walk = perform("walk", "neutral", seed=3, seconds=2.0).motion
    own = method.with_recipe(weights=(1.0, 0.0))
    own.learn(mk.load("data/actor/walk_old.bvh"), "an old person walks", title="")
    assert len(own.stylize(walk)) == 60
