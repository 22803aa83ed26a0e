"""The one lexicon, and rewriting the captions of all data sets with it."""

import re
from functools import cache

import pytest

import motionkit as mk
from motionkit import text
from motionkit.actor import CONTENTS
from motionkit.actor.performing import CREATURES, get_creature
from motionkit.actor.style import HELD_OUT_STYLES, TRAIN_STYLES
from motionkit.datasets import captures
from motionkit.text.captions import NEUTRAL, STYLES, form, style_phrase
from motionkit.text.captions import capture_captions as captured
from motionkit.text.captions import performed_captions as acted

PLAIN = {name for name, words in STYLES.items() if words is NEUTRAL}
# Styles and gaits of files of 100STYLE as they are named, one of each kind of name.
FILES = ("Aeroplane", "BeatChest", "InTheDark", "Kick", "March", "Neutral", "OnPhoneLeft", "SpinAntiClock", "Old")


@cache
def every() -> tuple[tuple[str, str, str], ...]:
    """Data set, style and caption of all that the data sets say; 100STYLE with its 100 styles in one gait."""
    found = [("actor", s, c) for s in (*TRAIN_STYLES, *HELD_OUT_STYLES) for d in CONTENTS for c in acted(d, s, 3, 6)]
    for kind in CREATURES:
        for deed in get_creature(kind).contents:
            found += [("creatures", s, c) for s in TRAIN_STYLES for c in acted(deed, s, 1, 4, subject=f"a {kind}")]
    for name, known in captures.BANDAI_LABELS.items():
        for deed in known["content"].split():
            found += [
                (name, s, c) for s in known["style"].split() for c in captures.bandai_labels(f"x_{deed}_{s}_1").texts
            ]
    found += [
        ("xia", s, c)
        for s in captures.XIA_STYLES
        for n in range(1, 29)
        for c in captures.xia_labels(f"{s}_{n}_0").texts
    ]
    for gait in captures.GAITS:
        labels = [captures.style100_labels(f"{name}_{gait}", "a long, old line: of words") for name in FILES]
        found += [("100style", one.style, c) for one in labels for c in one.texts]
    found += [("100style", s, c) for s in STYLES for c in captured("walking forward", "going on foot", s)]
    return tuple(found)


@cache
def tells(style: str) -> re.Pattern:
    """Any words that tell the style: phrases, adjectives, its name, and verbs in all their forms."""
    words = STYLES[style]
    verbs = [form(verb, ending) for verb in words.walks for ending in ("s", "ing", "ed")]
    phrases = [*words.how, *words.captured[:1], *verbs, *(f"{who} \\w+" for who in words.who)]
    named = [
        f"{style_phrase(style)} person",
        f"in an? {style_phrase(style)} (?:style|way)",
        f"the {style_phrase(style)} way",
    ]
    return re.compile(rf"\b(?:{'|'.join((*phrases, *named))})\b")


def test_every_style_of_the_data_sets_has_words():
    named = {s for known in captures.BANDAI_LABELS.values() for s in known["style"].split()}
    assert {*TRAIN_STYLES, *HELD_OUT_STYLES, *named, *captures.XIA_STYLES} <= set(STYLES)
    hundred = {s for s in STYLES if STYLES[s].how[0] == f"in a{'n' * (s[0] in 'aeiou')} {style_phrase(s)} style"}
    shared = {"angry", "depressed", "drunk", "neutral", "old", "proud", "robot", "strutting", "zombie"}
    assert len(hundred | shared) == 100
    assert all(len(STYLES[s].how) == 2 for s in hundred)


def test_to_neutral_leaves_no_word_of_the_style():
    assert len(every()) > 5_000
    for name, style, caption in every():
        neutral = text.to_neutral(caption)
        if style in PLAIN and ":" not in caption:
            assert neutral == caption, (name, caption, neutral)
        elif style not in PLAIN:
            assert tells(style).search(caption) or ":" in caption, (name, style, caption)
            assert not tells(style).search(neutral), (name, style, caption, neutral)
            assert neutral.count("neutrally") == 1, (name, caption, neutral)
        assert text.to_neutral(neutral) == neutral, (name, caption, neutral)


def test_to_neutral_keeps_what_is_done():
    for gait, (_, doing, again) in captures.GAITS.items():
        for name in FILES:
            for caption in captures.style100_labels(f"{name}_{gait}").texts:
                assert doing in text.to_neutral(caption) or again in text.to_neutral(caption), caption
    for style in captures.BANDAI_LABELS["bandai-2"]["style"].split():
        for caption in captures.bandai_labels(f"x_raise-up-left-hand_{style}_1").texts:
            assert re.search("(raising|lifting up) the left hand", text.to_neutral(caption)), caption


@pytest.mark.parametrize("style", STYLES)
def test_to_style_says_the_style(style):
    how, others = STYLES[style].how[0], [s for s in STYLES if s not in PLAIN]
    for n, (_, _, caption) in enumerate(every()[::97]):
        there = text.to_style(text.to_neutral(caption), style)
        assert there.count(how) == 1, (style, caption, there)
        assert text.to_style(there, style) == there == text.to_style(caption, style)
        assert text.to_neutral(text.to_style(there, others[n % len(others)])) == text.to_style(there, "neutral")


@pytest.mark.parametrize("style", ["very-odd", "in_a_hurry", "tick and tock"])
def test_styles_without_words(style):
    there = text.to_style("a person walks, then jumps", style)
    assert there == f"a person walks, then jumps, in a{'n' * (style[0] in 'aeiou')} {style_phrase(style)} style"
    assert text.to_style(there, style) == there
    assert text.to_neutral("a person walks in a very odd style") == "a person walks neutrally"


@pytest.mark.parametrize(
    ("caption", "neutral"),
    [
        ("a cat walks", "a cat walks"),  # a label of 100STYLE, and here who walks
        ("a chicken kicks, then a monk jumps", "a chicken kicks, then a monk jumps"),
        ("the zombie sits down", "the zombie sits down"),
        ("a person is marching", "a person is marching"),
        ("a person shows the way", "a person shows the way"),
        ("a person walks in the same way", "a person walks in the same way"),
        ("A big steps person runs.", "A person runs neutrally."),
        ("a person runs like a penguin", "a person runs neutrally"),
        ("a person runs in a march way", "a person runs neutrally"),
        ("a person is walking: the legs, stiff: and old.", "a person is walking neutrally"),
        ("note: a person walks", "note: a person walks"),
        ("a person bows in a hall in a free style", "a person bows in a hall neutrally"),
    ],
)
def test_sentences_of_others(caption, neutral):
    assert text.to_neutral(caption) == neutral


def test_a_language_model_may_do_it():
    asked = []

    def ask(prompt: str) -> str:
        asked.append(prompt)
        return '\n "a person walks gloomily"\n'

    assert text.to_neutral("a person mopes about", ask) == "a person walks gloomily"
    assert text.to_style("a person mopes about", "old", ask=ask) == "a person walks gloomily"
    assert all(prompt.endswith("Sentence: a person mopes about") for prompt in asked)
    assert '"old"' in asked[1] and "in old age" in asked[1] and len(asked) == 2


@pytest.mark.parametrize("answer", ["", "  \n", "a person walks\nHope this helps!", None, '""'])
def test_answers_that_are_no_sentence(answer):
    for rewrite in (text.to_neutral, lambda caption, ask: text.to_style(caption, "old", ask)):
        with pytest.raises(mk.MotionKitError, match="was to answer with one sentence.*'a person walks'.*leave ask out"):
            rewrite("a person walks", lambda prompt: answer)
        with pytest.raises(mk.MotionKitError, match="the sentence is empty"):
            rewrite(" ", lambda prompt: "a person walks")
