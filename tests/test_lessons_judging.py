"""Notebook 04: pictures and widgets show the numbers they are given, and say what is wrong with them."""

import base64
import json
import time

import numpy as np
import pytest
import torch
from looking import cloud, near, pixels
from matplotlib.patches import Ellipse
from plotly.callbacks import Points

import motionkit as mk
from motionkit.lessons import judging
from motionkit.lessons.judging import cloud_explorer, embed, feature_map, plot_clouds, plot_confusion


def test_clouds_are_told_by_their_fmd_and_its_parts():
    a, b = cloud(300), 2 * cloud(300, seed=1) + torch.tensor([3.0, 1.0])
    title = plot_clouds(a, b, parts=True).axes[0].get_title(loc="left")
    whole, means, spreads = (float(word) for word in title.split() if word[0].isdigit())
    assert whole == pytest.approx(mk.metrics.fmd(a, b), abs=0.006)
    assert means == pytest.approx(float(((a.mean(0) - b.mean(0)) ** 2).sum()), abs=0.006)
    assert spreads == pytest.approx(whole - means, abs=0.011) and spreads > 1
    assert plot_clouds(a, b).axes[0].get_title(loc="left") == title.split(" =")[0]


def test_an_ellipse_holds_the_share_of_points_that_a_gaussian_has_there():
    a = cloud(4000) @ torch.tensor([[2.0, 1.0], [0.0, 0.5]])
    ax = plot_clouds(a, a, labels=("one", "two")).axes[0]
    found = [patch for patch in ax.patches if isinstance(patch, Ellipse)]
    assert len(found) == 4
    for ellipse, deviations in zip(found, (1, 2, 1, 2)):
        inside = ellipse.get_patch_transform().inverted().transform(a.numpy())
        share = float((np.hypot(*inside.T) < 1).mean())
        assert share == pytest.approx(1 - np.exp(-(deviations**2) / 2), abs=0.02)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["one: 4,000", "two: 4,000"]


def test_clouds_can_be_drawn_into_given_axes_and_stay_small():
    picture = plot_clouds(cloud(3000), cloud(3000, seed=1))
    assert all(len(line.get_xdata()) <= 2000 for line in picture.axes[0].lines)
    drawn = picture._repr_png_()
    assert len(drawn) < 60_000
    assert all(near(pixels(drawn), ink, 60) > 300 for ink in judging.CLOUD_COLOURS)
    assert plot_clouds(cloud(9), cloud(9), ax=picture.axes[0]) is picture


@pytest.mark.parametrize(
    ("a", "labels", "said"),
    [
        (cloud(9, 3), ("real", "made"), r"'real' as a tensor of points \[N, 2\]; found \[9, 3\]"),
        ([[1, 2]], ("real", "made"), "found a list"),
        (cloud(2), ("mine", "made"), "mine has 2 rows"),
        (torch.full((5, 2), torch.nan), ("mine", "made"), "mine"),
        (cloud(9), ("one",), "two labels"),
    ],
)
def test_clouds_say_what_is_wrong(a, labels, said):
    with pytest.raises(mk.MotionKitError, match=said):
        plot_clouds(a, cloud(9), labels)


def second_line(explorer: object) -> float:
    picture = explorer._draw(**explorer.values())
    return float(picture.axes[0].texts[0].get_text().rsplit(" ", 1)[1])


def test_the_explorer_moves_and_names_the_true_distance(caplog):
    explorer = cloud_explorer()
    for name, value in {"shift": 3.0, "spread": 2.0, "turn": -60, "points": 20}.items():
        before = explorer.png
        explorer.controls[name].value = value
        assert explorer.png != before, name
    explorer.set(shift=2.0, spread=1.0, turn=0, points=300)
    assert second_line(explorer) == 4.0
    explorer.set(shift=0.0, spread=2.0)
    assert second_line(explorer) == pytest.approx(1 + 0.4**2, abs=0.006)
    explorer.set(spread=1.0, turn=90)
    assert second_line(explorer) == pytest.approx(2 * (1 - 0.4) ** 2, abs=0.006)
    assert caplog.messages == []  # matplotlib logs what it could not fit


def test_few_points_measure_too_much_and_many_nearly_the_truth():
    explorer = cloud_explorer()
    measured = []
    for points in (5, 3000):
        explorer.set(shift=0.0, spread=1.0, turn=0, points=points)
        title = explorer._draw(**explorer.values()).axes[0].get_title(loc="left")
        measured.append(float(title.split()[1]))
    assert second_line(explorer) == 0 and measured[0] > 0.1 > 0.02 > measured[1]


def cells(ax: object) -> dict[tuple[int, int], str]:
    return {(round(t.get_position()[1]), round(t.get_position()[0])): t.get_text() for t in ax.texts}


def test_cells_are_per_cent_of_their_row_and_empty_ones_stay_empty():
    counts = torch.tensor([[3, 1, 0], [0, 8, 0], [1, 0, 399]])
    ax = plot_confusion(counts, ["walk", "run", "jump"], "content").axes[0]
    assert cells(ax) == {(0, 0): "75", (0, 1): "25", (1, 1): "100", (2, 0): "<1", (2, 2): "100"}
    assert ax.get_title(loc="left") == "content: accuracy 100 %"  # 410 of 412
    assert [t.get_text() for t in ax.get_yticklabels()] == ["walk", "run", "jump"]
    assert ax.images[0].get_array()[0].tolist() == [75, 25, 0]


def test_accuracy_in_the_title_is_the_metrics():
    scores, labels = cloud(90, 9), torch.arange(90) % 9
    title = plot_confusion(mk.metrics.confusion(scores, labels), list("abcdefghi")).axes[0].get_title(loc="left")
    assert title == f"accuracy {mk.metrics.recognition_accuracy(scores, labels):.0f} %"


def test_a_class_without_clips_leaves_an_empty_row():
    ax = plot_confusion(torch.tensor([[2, 0], [0, 0]]), ["walk", "run"]).axes[0]
    assert cells(ax) == {(0, 0): "100"} and ax.get_title(loc="left") == "accuracy 100 %"


def test_twelve_classes_beside_eight_can_be_read():
    tables = [50 * torch.eye(12).long() + 3, 50 * torch.eye(8).long() + 3]
    tables[0][3, 4] = tables[1][3, 4] = 30  # a cell neither light nor dark
    names = [[f"content_{n:02}" for n in range(12)], [f"style_{n}" for n in range(8)]]
    picture = plot_confusion(tables, names, ["content", "style"])
    assert [ax.get_title(loc="left") for ax in picture.axes] == ["content: accuracy 60 %", "style: accuracy 68 %"]
    assert picture.get_size_inches()[0] <= 11 and len(picture._repr_png_()) < 60_000
    for ax in picture.axes:
        boxes = [text.get_window_extent() for text in ax.texts]
        wide = ax.transData.transform((1, 0))[0] - ax.transData.transform((0, 0))[0]
        assert max(box.width for box in boxes) < 0.8 * wide and min(t.get_fontsize() for t in ax.texts) >= 7.5
        for text in ax.texts:  # light on dark, dark on light
            column, row = text.get_position()
            dark = ax.images[0].get_array()[row, column] > 55
            assert (text.get_color() == "white") == dark


@pytest.mark.parametrize(
    ("counts", "labels", "said"),
    [
        (torch.ones(2, 3), ["a", "b"], r"found \[2, 3\]"),
        (torch.ones(2, 2), ["a"], "a label for each of 2 classes; found 1"),
        (torch.ones(2, 2), "ab", "found 'ab'"),
        (np.ones((2, 2)), ["a", "b"], "found a ndarray"),
        (-torch.ones(2, 2), ["a", "b"], "negative"),
        ([torch.ones(2, 2)] * 2, [["a", "b"]], "2 tables of counts, 1 lists of labels"),
        ([], [], "0 tables"),
    ],
)
def test_confusion_says_what_is_wrong(counts, labels, said):
    with pytest.raises(mk.MotionKitError, match=said):
        plot_confusion(counts, labels)


PLOTLY, VIEW = "application/vnd.plotly.v1+json", "application/vnd.jupyter.widget-view+json"


def grouped(rows: int, groups: int = 4, seed: int = 0) -> torch.Tensor:
    """Features of groups that lie far apart, row n in group n % groups."""
    return 10 * torch.eye(groups)[torch.arange(rows) % groups] + cloud(rows, groups, seed)


def test_neighbours_stay_neighbours_and_a_seed_says_all():
    features = grouped(80)
    places = embed(features)
    assert torch.equal(places, embed(features.double()))
    away = torch.cdist(places, places).fill_diagonal_(torch.inf)
    assert torch.equal(away.argmin(1) % 4, torch.arange(80) % 4)


def test_rows_that_are_not_finite_stay_in_their_place():
    features = grouped(40)
    features[5, 1], features[7, 0] = torch.nan, torch.inf
    places = embed(features)
    assert (~places.isfinite()).all(1).nonzero().flatten().tolist() == [5, 7]
    kept = [n for n in range(40) if n not in (5, 7)]
    assert torch.equal(places[kept], embed(features[kept]))


@pytest.mark.parametrize(
    ("features", "said"),
    [
        (cloud(3, 5), "at least 4 finite rows"),
        (torch.ones(9, 5), "all 9 rows are alike"),
        (cloud(9, 1), "D at least 2"),
        (cloud(9)[0], r"found \[2\]"),
        ([1.0, 2.0], "found a list"),
    ],
)
def test_embedding_says_what_is_wrong(features, said):
    with pytest.raises(mk.MotionKitError, match=said):
        embed(features)


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_the_size_of_features_does_not_matter(scale):
    places = embed(grouped(40).double() * scale)
    away = torch.cdist(places, places).fill_diagonal_(torch.inf)
    assert torch.equal(away.argmin(1) % 4, torch.arange(40) % 4)


@pytest.mark.slow
def test_eight_hundred_points_are_quick():
    features = grouped(800, 8)
    start = time.process_time()  # of this process alone: a busy machine is not the map's fault
    embed(features)
    assert time.process_time() - start < 15


def test_a_map_has_a_group_for_each_label_and_names_every_dot():
    features, labels = cloud(30), ["walk", "run", "jump"] * 10
    figure = feature_map(features, labels, names=[f"clip {n}" for n in range(30)])
    assert [trace.name for trace in figure.data] == ["jump", "run", "walk"]
    for first, trace in zip((2, 1, 0), figure.data):
        own = features[first::3]
        assert trace.x == pytest.approx(own[:, 0].tolist(), abs=1e-3)  # two numbers a row are drawn as they are
        assert trace.y == pytest.approx(own[:, 1].tolist(), abs=1e-3)
        assert trace.text == tuple(f"clip {n}" for n in range(first, 30, 3))
    assert figure.layout.annotations == ()
    assert len({(trace.marker.color, trace.marker.symbol) for trace in figure.data}) == 3


def test_a_saved_map_holds_a_picture_of_all_groups_in_few_bytes():
    figure = feature_map(cloud(800), [f"group {n % 12:02}" for n in range(800)])
    bundle = figure._repr_mimebundle_()
    assert len(json.dumps(bundle[PLOTLY])) < 80_000 and bundle["text/plain"].startswith("Map(800 dots by content: ")
    still = base64.b64decode(bundle["image/jpeg"])
    assert len(still) < 60_000
    assert all(near(pixels(still), colour, 30) > 30 for colour in judging.MAP_COLOURS)


def test_the_caption_counts_what_is_left_out():
    features, labels = cloud(60), ["walk"] * 60
    features[:7] = torch.nan
    figure = feature_map(features, labels, most=20)
    assert figure.layout.annotations[0].text == "20 of 53 clips, chosen by chance; 7 left out: features not finite"
    assert len(figure.data[0].x) == 20
    again, other = feature_map(features, labels, most=20), feature_map(features, labels, most=20, seed=1)
    assert figure.data[0].text == again.data[0].text != other.data[0].text
    assert not {str(n) for n in range(7)} & set(figure.data[0].text)
    assert figure.data[0].text == tuple(sorted(figure.data[0].text, key=int))


def lab_colours(colours: tuple[str, ...], seen_as: np.ndarray) -> np.ndarray:
    """CIE Lab of `#rrggbb` colours, seen through a matrix on linear light."""
    light = np.array([[int(c[n : n + 2], 16) / 255 for n in (1, 3, 5)] for c in colours])
    light = np.where(light <= 0.04045, light / 12.92, ((light + 0.055) / 1.055) ** 2.4)
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    x, y, z = (np.clip(light @ seen_as.T, 0, 1) @ to_xyz.T / (0.9505, 1, 1.089)).T
    x, y, z = (np.where(v > 0.008856, np.cbrt(v), 7.787 * v + 16 / 116) for v in (x, y, z))
    return np.stack((116 * y - 16, 500 * (x - y), 200 * (y - z)), 1)


@pytest.mark.parametrize(
    "seen_as",  # Machado, Oliveira and Fernandes 2009, full strength
    [
        np.eye(3),
        np.array([[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]),
        np.array([[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.01182, 0.04294, 0.968881]]),
    ],
    ids=["most people", "without red cones", "without green cones"],
)
def test_twelve_colours_keep_apart_for_everybody(seen_as):
    found = lab_colours(judging.MAP_COLOURS, seen_as)
    away = np.linalg.norm(found[:, None] - found[None], axis=-1) + 1e9 * np.eye(12)
    assert away.min() > 20  # about ten times what an eye can just tell


def test_more_than_twelve_labels_differ_in_colour_or_mark():
    figure = feature_map(cloud(40), [f"{n:02}" for n in range(40)])
    assert len({(trace.marker.color, trace.marker.symbol) for trace in figure.data}) == 40


@pytest.fixture(scope="module")
def clips():
    walk = mk.load("data/actor/walk_neutral.bvh")
    return [walk[n : n + 20 + n].replace(name=f"clip {n}") for n in range(12)]


def hover(view: object, group: int, number: int) -> None:
    view.figure.data[group]._dispatch_on_hover(Points(point_inds=[number]), None)


def test_pointing_at_a_dot_plays_its_clip(clips):
    features = cloud(12)
    features[1] = torch.nan
    view = feature_map(features, ["walk", "run", "jump"] * 4, clips)
    assert view.shown == 0 and view.player.motions[0].name == "clip 0"
    view.player.playing, view.player.frame = False, 5
    hover(view, 1, 0)  # the first run that is there: row 1 is not
    assert view.shown == 4 and view.player.motions[0].name == "clip 4" and len(view.player.motions[0]) == 24
    assert view.player.playing and view.player.frame == 0
    ring = view.figure.data[-1]
    assert (ring.x[0], ring.y[0]) == pytest.approx(features[4].tolist())
    view.figure.data[2]._dispatch_on_click(Points(point_inds=[3]), None)
    assert view.shown == 9
    view.figure.data[0]._dispatch_on_click(Points(point_inds=[3]), None)
    assert view.shown == 11


def test_staying_on_a_dot_lets_its_clip_play_on(clips):
    view = feature_map(cloud(12), ["walk"] * 12, clips)
    hover(view, 0, 6)
    view.player.frame = 9
    hover(view, 0, 6)
    assert view.player.frame == 9
    hover(view, 0, 0)
    assert view.player.frame == 0


def test_a_map_with_motions_leaves_a_still(clips):
    view = feature_map(cloud(12), ["walk", "run"] * 6, clips, by="gait")
    bundle = view._repr_mimebundle_()
    assert VIEW in bundle and bundle["text/plain"] == "Map(12 dots by gait: run, walk)"
    still = base64.b64decode(bundle["image/png"])
    assert len(still) < 40_000 and near(pixels(still), judging.MAP_COLOURS[0], 20) > 60
    picture = judging.draw_map(view._drawn)
    assert [len(line.get_xdata()) for line in picture.axes[0].lines] == [6, 6]
    assert picture.axes[0].get_legend().get_title().get_text() == "gait"
    with pytest.raises(mk.MotionKitError, match="row 12 is not on this map"):
        view.show(12)


def test_maps_say_what_is_wrong(clips):
    labels = ["walk"] * 12
    for given, said in (
        (dict(labels=labels[:3]), "12 labels, one for each row of features; found 3"),
        (dict(labels="walk"), "found 'walk'"),
        (dict(labels=labels, motions=clips[:4]), "12 motions"),
        (dict(labels=labels, names=["a"]), "12 names"),
        (dict(labels=labels, most=2), "most=4 rows or more, found 2"),
    ):
        with pytest.raises(mk.MotionKitError, match=said):
            feature_map(cloud(12), **given)
    with pytest.raises(mk.MotionKitError, match="none of the 5 rows of features is finite"):
        feature_map(torch.full((5, 9), torch.nan), ["walk"] * 5)
