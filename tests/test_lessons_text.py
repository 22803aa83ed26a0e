"""The prompt box moves when it is told to, and tells what is wrong in place of a traceback."""

import io
import warnings

import pytest
import torch
from PIL import Image

import motionkit as mk
from motionkit import diffusion, features, layers, skeleton, text
from motionkit.lessons.text import PromptBox
from motionkit.methods import text_to_motion

KNOWN = ("a person walks", "an old person walks", "a person waves")


class Letters(text.TextEncoder):
    """How often each letter occurs."""

    name, size, key = "letters", 26, text.content_key({}, "letters")

    def embed(self, texts):
        return torch.tensor([[float(one.lower().count(chr(97 + n))) for n in range(26)] for one in texts])


@pytest.fixture(scope="module")
def prior():
    torch.manual_seed(0)
    layout = features.facing_free.OfBody(skeleton.smpl(), 30)
    network = layers.Denoiser(layout.size, 26, layers.TransformerConfig.tiny()).eval()
    normalizer = features.Normalizer(torch.zeros(layout.size), torch.ones(layout.size), "FacingFree", "none")
    return text_to_motion.Prior(network, layout, normalizer, diffusion.NoiseSchedule.cosine(), Letters(), KNOWN, 0.8)


@pytest.fixture
def box(prior):
    return PromptBox(prior, "a person walks", seconds=1.0, steps=2)


def same(a, b):
    return len(a) == len(b) and torch.equal(a.positions(), b.positions())


def test_it_shows_what_the_prior_makes(box, prior):
    assert same(box.motion, prior.generate("a person walks", 1.0, steps=2)[0])
    assert box.player.motions[0] is box.motion
    assert box.message == "nearest known: 'a person walks', similarity 1.00"


@pytest.mark.parametrize(
    "name, value, more",
    [("prompt", "a person waves", {}), ("seconds", 2.0, {}), ("scale", 1.0, {}), ("seed", 7, {})],
)
def test_every_control_is_followed(box, prior, name, value, more):
    before = box.motion
    box.controls[name].value = value
    asked = {"prompts": "a person walks", "seconds": 1.0, "scale": text_to_motion.GUIDANCE_SCALE, "seed": 0}
    asked["prompts" if name == "prompt" else name] = value
    assert same(box.motion, prior.generate(**asked, steps=2)[0]) and not same(box.motion, before)
    assert box.player.motions[0] is box.motion


def test_another_takes_other_noise(box):
    before = box.motion
    box._more.click()
    assert box.controls["seed"].value == 1 and not same(box.motion, before)


def test_the_button_does_not_make_the_same_again(box):
    before = box.motion
    box._go.click()
    assert box.motion is before


def test_an_empty_sentence_is_answered_in_the_box_and_the_motion_stays(box):
    before = box.motion
    box.controls["prompt"].value = "  "
    assert "the prompt is empty; say what someone does" in box.message
    assert box.motion is before and box.player.motions == [before] and not box._go.disabled
    box.controls["prompt"].value = "a person waves"
    assert box.message.startswith("nearest known: 'a person waves'") and box.motion is not before


def test_a_far_sentence_is_performed_and_its_nearest_named(box):
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # said in the box, and nowhere else
        box.controls["prompt"].value = "zzz <b>xyz</b>"
    assert "is far from anything known" in box.message and "'a person" in box.message
    assert box.motion.name == "zzz <b>xyz</b>"
    assert "&lt;b&gt;" in box._text.value and "<b>" not in box._text.value


def test_a_first_sentence_that_will_not_do_is_an_error(prior):
    with pytest.raises(mk.MotionKitError, match="the prompt is empty"):
        PromptBox(prior, "")
    with pytest.raises(mk.MotionKitError, match="seconds: this prior learned"):
        PromptBox(prior, seconds=60)
    with pytest.raises(mk.MotionKitError, match="expected a prior, such as mk.methods.text_to_motion.load"):
        PromptBox("actor")


def test_a_prior_that_cannot_be_guided_has_no_slider_for_it(prior):
    plain = text_to_motion.Prior(
        prior.network, prior.layout, prior.normalizer, prior.schedule, prior.encoder, KNOWN, 0.8, guided=False
    )
    box = PromptBox(plain, "a person walks", seconds=1.0, steps=2)
    assert box.controls["scale"].disabled and box.controls["scale"].value == 1.0


def test_a_page_without_a_kernel_gets_a_picture(box):
    bundle = box._repr_mimebundle_()
    before = box.still()
    assert "image/png" in bundle and "application/vnd.jupyter.widget-view+json" in bundle
    assert len(before) < 60_000
    assert Image.open(io.BytesIO(before)).size[0] > 700
    box.controls["prompt"].value = "an old person walks"
    assert box.still() != before


def test_a_table_of_cosines_has_its_numbers_and_marks():
    near = torch.tensor([[1.0, 0.25], [-0.5, 0.9], [0.0, 0.5]])
    picture = mk.lessons.text.plot_similarity(near, ["a", "b", "c"], ["d", "e"], marks=[(1, 1)])
    ax = picture.axes[0]
    assert [text.get_text() for text in ax.texts] == ["1.00", "0.25", "-0.50", "0.90", "0.00", "0.50"]
    assert [patch.get_xy() for patch in ax.patches] == [(0.5, 0.5)]
    assert [text.get_text() for text in ax.get_xticklabels()] == ["d", "e"]
    large = mk.lessons.text.plot_similarity(torch.eye(20), [str(n) for n in range(20)])
    assert not large.axes[0].texts
    with pytest.raises(mk.MotionKitError, match=r"a table \[2, 2\]"):
        mk.lessons.text.plot_similarity(near, ["a", "b"])
