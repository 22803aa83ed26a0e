"""Pictures of diffusion show what they are given, and say what is wrong with it."""

import pytest
import torch
from looking import cloud, near, pixels

import motionkit as mk
from motionkit.lessons.diffusion import SAMPLER_COLOURS, plot_film, plot_poses, plot_quality, slide


def test_a_film_shows_each_cloud_at_one_scale_with_its_classes():
    labels = torch.arange(90) % 2
    picture = plot_film({"a": cloud(90), "b": 2 * cloud(90)}, labels, shadow=cloud(40), names=("old", "young"))
    for ax, scale in zip(picture.axes, (1, 2)):
        assert ax.get_xlim() == (-4, 4) and len(ax.lines) == 3  # the shadow and two classes
        drawn = torch.tensor(ax.lines[2].get_xydata())
        torch.testing.assert_close(drawn, scale * cloud(90)[labels == 1].double(), check_dtype=False)
    assert [text.get_text() for text in picture.axes[0].get_legend().get_texts()] == ["old", "young"]
    assert picture.axes[1].get_legend() is None
    image = pixels(picture._repr_png_())
    assert all(near(image, ink, 100) > 100 for ink in SAMPLER_COLOURS[:2])


def test_a_film_of_a_great_cloud_stays_small():
    picture = plot_film({str(n): cloud(6000, seed=n) for n in range(6)})
    assert len(picture._repr_png_()) < 90_000


@pytest.mark.parametrize(
    ("clouds", "labels", "said"),
    [
        ({}, None, "found none"),
        ({"a": cloud(9, 3)}, None, r"'a' must be points \[N, 2\], a label for each; found \[9, 3\]"),
        ({"a": cloud(9)}, torch.zeros(8).long(), "with 8 labels"),
    ],
)
def test_a_film_says_what_is_wrong(clouds, labels, said):
    with pytest.raises(mk.MotionKitError, match=said):
        plot_film(clouds, labels)


@pytest.fixture(scope="module")
def walk():
    return mk.load("data/actor/walk_neutral.bvh")


def test_poses_stand_in_a_row_with_their_captions(walk):
    frames = walk[:50:10]
    captions = [f"step {n}" for n in range(5)]
    picture = plot_poses([frames, frames], captions, labels=["one", "two"])
    texts = [text.get_text() for text in picture.axes[0].texts]
    assert texts == ["one", "two", *captions]
    strip = mk.strip([frames.replace(fps=1.0)] * 2, poses=5)
    assert len(picture.axes[0].collections) == len(strip.axes[0].collections)  # every pose of both rows is there
    assert [text.get_text() for text in plot_poses(frames).axes[0].texts][-5:] == [""] * 5


def test_rows_of_poses_must_agree(walk):
    with pytest.raises(mk.MotionKitError, match=r"rows have \[5, 4\] frames"):
        plot_poses([walk[:5], walk[:4]])
    with pytest.raises(mk.MotionKitError, match="there are 2 captions"):
        plot_poses(walk[:5], ["a", "b"])


def test_quality_is_drawn_over_steps_and_over_seconds():
    runs = {"ddim": [(5, 0.1, 2.0), (50, 1.0, 0.5)], "ddpm": [(5, 0.2, 4.0), (50, 2.0, 0.6)]}
    picture = plot_quality(runs, floor=0.4, ylabel="energy")
    for ax, column in zip(picture.axes, (0, 1)):
        assert [[tuple(point) for point in line.get_xydata()] for line in ax.lines[:2]] == [
            [(point[column], point[2]) for point in points] for points in runs.values()
        ]
        assert set(ax.lines[2].get_ydata()) == {0.4}
    assert [text.get_text() for text in picture.axes[0].get_xticklabels()] == ["5", "50"]
    texts = [text.get_text() for text in picture.axes[0].get_legend().get_texts()]
    assert texts == ["ddim", "ddpm", "real against real"]


@pytest.mark.parametrize("points", [[], [(5, 1.0)], [(5, 0.0, 1.0)]])
def test_quality_says_what_is_wrong(points):
    with pytest.raises(mk.MotionKitError, match="'ddim' must be"):
        plot_quality({"ddim": points})


def test_a_slider_draws_its_picture_anew_and_leaves_the_last_one():
    asked = []

    def draw(t, scale):
        asked.append((t, scale))
        return plot_film({f"{t}, {scale}": scale * cloud(20)})

    picture = slide(draw, t=(range(0, 1001, 100), 300), scale=((0.5, 1.0), 1.0))
    before = picture.png
    picture.controls["t"].value = 600
    assert asked == [(300, 1.0), (600, 1.0)] and picture.png != before
    left = picture._repr_mimebundle_()
    assert left["image/png"] and left["text/plain"] == "(sliders: run this cell)"


def test_a_slider_starts_at_one_of_its_values():
    with pytest.raises(mk.MotionKitError, match="t cannot start at 7; its values are "):
        slide(lambda t: None, t=(range(5), 7))
