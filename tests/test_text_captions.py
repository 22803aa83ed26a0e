"""Sentences about performances and captures, the one lexicon, and rewriting them from style to neutral and back."""

import re
from functools import cache

import pytest

import motionkit as mk
from motionkit.actor import CONTENTS, perform, retell
from motionkit.actor.performing import CREATURES, get_creature
from motionkit.actor.style import HELD_OUT_STYLES, TRAIN_STYLES
from motionkit.datasets import captures
from motionkit.text import to_neutral, to_style
from motionkit.text.captions import NEUTRAL, STYLES, capture_captions, form, performed_captions, style_phrase

NAMES = TRAIN_STYLES + HELD_OUT_STYLES
STYLED = [name for name in NAMES if name != "neutral"]
SEQUENCE = "walk, jump, kick"
# What each content cannot be told without, in any form of the verb.
CORE = {
    "walk": "walk", "walk_turn_left": "left", "walk_turn_right": "right", "walk_back": "back",
    "run": "run|ran|runn|jog", "jump": "jump|leap", "kick": "kick", "punch": "punch", "wave": "wav|hello",
    "raise_hands": "rais|lift|put", "bow": "bow", "idle": "stand|stood|wait", "trot": "trot",
}  # fmt: skip


@cache
def every(style: str, count: int = 12) -> list[tuple[str, str]]:
    """Captions of all contents and a sequence in a style, with what is done."""
    contents = (*CONTENTS, SEQUENCE)
    return [(content, text) for content in contents for text in performed_captions(content, style, seed=5, count=count)]


@cache
def words_of(style: str) -> re.Pattern:
    """Any word that tells the style: phrases, adjectives, and verbs in all their forms."""
    how, who, walks = STYLES[style][:3]
    stems = [re.sub("(e|p|t)$", "", walk) for walk in walks] + (["strode"] if "stride" in walks else [])
    stems += ["crept"] if "creep" in walks else []
    return re.compile(rf"\b({'|'.join((*how, *who))})\b" + (rf"|\b({'|'.join(stems)})" if stems else ""))


@pytest.mark.parametrize("style", NAMES)
def test_captions_tell_content_and_style(style):
    for content, text in every(style):
        for one in content.split(", "):
            assert re.search(CORE[one], text) or (one == "walk" and words_of(style).search(text)), text
        if style != "neutral":
            assert words_of(style).search(text), text


@pytest.mark.parametrize("style", NAMES)
def test_captions_are_grammatical(style):
    for _, text in every(style):
        assert not re.search(r"\ba [aeiou]|\ban [^aeiou]|  |[{}%]|^ | $|\bNone\b", text), text
        assert re.match(r"(a|an|the) [\w -]*person |(someone|somebody) ", text), text
        past = "ran|stood|bent|threw|took|put|strode|crept"
        verb = r" is (\w+ly )?\w+ing\b" if " is " in text else rf"(person|one|body) (\w+ly )?(\w+(s|ed)|{past})\b"
        assert re.search(verb, text), text


def test_at_least_four_and_all_different():
    for content in (*CONTENTS, SEQUENCE):
        for style in NAMES:
            told = performed_captions(content, style)
            assert len(told) == len(set(told)) == 4
            assert len(set(performed_captions(content, style, count=12))) == 12


def test_the_first_is_the_papers_form():
    assert performed_captions("run", "depressed")[0] == "a person is running in depression"
    assert performed_captions("walk")[0] == "a person is walking neutrally"
    assert performed_captions(["walk", "jump"], "tired")[0] == "a person is walking and then jumping, in weariness"
    assert performed_captions("walk", "drunk", subject="an ostrich")[0] == "an ostrich is walking in drunkenness"
    shared = [s for s in NAMES if STYLES[s].captured]
    assert len(shared) >= 8  # captures and the performer speak alike
    for style in shared:
        assert performed_captions("run", style)[0] == capture_captions("running", "", style)[0]


def test_neutral_with_and_without_saying_so():
    for content in CONTENTS:
        told = performed_captions(content, "neutral")
        plain = [t for t in told if not re.search("neutral|normal|ordinary", t)]
        assert 1 <= len(plain) < len(told)


def test_seed_says_which():
    assert performed_captions("walk", "old", 3) == performed_captions("walk", "old", 3)
    assert len({performed_captions("walk", "old", seed)[1:] for seed in range(5)}) == 5
    subjects = {text.split(" ")[0] for seed in range(10) for text in performed_captions("walk", "neutral", seed)}
    assert subjects >= {"a", "the", "someone", "somebody"}


def test_any_subject():
    for text in performed_captions("walk", "angry", 1, 8, subject="an ant"):
        assert re.match(r"(an? |the )([\w-]+ )?ant ", text) and "person" not in text, text
    assert performed_captions("sit", "neutral", subject="a dog")[0] == "a dog is sitting down neutrally"
    assert performed_captions("peck", "old", subject="a ostrich")[0] == "an ostrich is pecking in old age"
    assert performed_captions("tail_swing", "old")[0] == "a person is tailing swing in old age"


def test_limbs_are_told_where_they_are_known():
    kick = perform("kick", "old", seed=3, seconds=4)
    sides = {act.side for act in kick.score.acts if act.name == "kick"}
    assert len(sides) == 1
    leg = {1: "left leg", -1: "right leg"}[sides.pop()]
    assert all(leg in text for text in kick.captions)
    assert all(leg in text for text in retell(kick, "proud").captions)
    both = perform("kick", "angry", seed=3, seconds=8)
    assert {act.side for act in both.score.acts if act.name == "kick"} == {1, -1}
    assert not any(re.search("left|right", text) for text in both.captions)
    wave = perform("wave", "neutral", seed=2, seconds=6).captions
    assert all(re.search("with the (left|right) hand", text) for text in wave)


def test_performances_bring_captions():
    told = perform("walk, jump", "tired", seed=1, seconds=12).captions
    assert len(told) == 4 and told[0] == "a person is walking and then jumping, in weariness"


def test_intensity_and_own_styles():
    from motionkit.actor import Style

    assert perform("walk", "old", intensity=1.5, seconds=2).captions[0] == "a person is walking in old age"
    assert perform("walk", "old", intensity=0, seconds=2).captions[0] == "a person is walking neutrally"
    assert perform("walk", Style("in-a-hurry"), seconds=2).captions[0] == "a person is walking in an in a hurry style"


@pytest.mark.parametrize("style", STYLED)
def test_to_neutral_takes_all_words_of_style(style):
    every_word = re.compile("|".join(f"(?:{words_of(s).pattern})" for s in STYLED))
    for content, text in every(style):
        neutral = to_neutral(text)
        assert not every_word.search(neutral), (text, neutral)
        assert neutral.count("neutrally") == 1, (text, neutral)
        assert to_neutral(neutral) == neutral
        for one in content.split(", "):
            assert re.search(CORE[one], neutral), (text, neutral)


@pytest.mark.parametrize("style", STYLED)
def test_to_style_says_the_style(style):
    how = STYLES[style].how[0]
    for other in {*NAMES[::3], style}:
        for _, text in every(other, count=4):
            there = to_style(to_neutral(text), style)
            assert there.count(how) == 1, (text, there)
            assert not re.search("neutral|normal|ordinary", there)
            assert to_style(there, style) == there == to_style(text, style)
            assert to_neutral(there) == to_style(to_neutral(text), "neutral")


def test_neutral_captions_stay_as_they_are():
    for _, text in every("neutral"):
        assert to_neutral(text) == text


@pytest.mark.parametrize("style", sorted(set(STYLES) - {"neutral", "normal"}))
def test_captions_of_captures_are_rewritten_too(style):
    for text in capture_captions("running", "jogging along", style):
        assert re.fullmatch("(a person|someone) is (running|jogging along) neutrally", to_neutral(text)), text


@pytest.mark.parametrize(
    ("caption", "neutral"),
    [
        ("A person walks in depression.", "A person walks neutrally."),
        ("An old, tired man walks.", "A man walks neutrally."),
        ("a very angry person stomps, then jumps", "a person walks, then jumps, neutrally"),
        ("someone strides proudly ahead", "someone walks neutrally ahead"),
        ("a person walks wearily and in old age", "a person walks neutrally"),
        ("a person takes long strides", "a person takes long strides"),
        ("a person lifts an old box", "a person lifts an old box"),
        ("a person walks like a tired old man", "a person walks neutrally"),
        ("", ""),
    ],
)
def test_sentences_of_others(caption, neutral):
    assert to_neutral(caption) == neutral


def test_bad_input():
    for style in ("", "--", None):
        with pytest.raises(mk.MotionKitError, match="style: expected a label"):
            to_style("a person walks", style)
    for rewritten in (to_neutral, lambda caption: to_style(caption, "old")):
        with pytest.raises(mk.MotionKitError, match="caption: expected a sentence; found 3"):
            rewritten(3)
    for count in (0, -1, 1.5, "4"):
        with pytest.raises(mk.MotionKitError, match="count: expected a whole number"):
            performed_captions("walk", "old", count=count)
    with pytest.raises(mk.MotionKitError, match="count: there are"):
        performed_captions("punch", "old", count=2_000)


PLAIN = {name for name, words in STYLES.items() if words is NEUTRAL}
# Styles and gaits of files of 100STYLE as they are named, one of each kind of name.
FILES = ("Aeroplane", "BeatChest", "InTheDark", "Kick", "March", "Neutral", "OnPhoneLeft", "SpinAntiClock", "Old")


@cache
def every_caption() -> tuple[tuple[str, str, str], ...]:
    """Data set, style and caption of all that the data sets say; 100STYLE with its 100 styles in one gait."""
    found = [
        ("actor", s, c)
        for s in (*TRAIN_STYLES, *HELD_OUT_STYLES)
        for d in CONTENTS
        for c in performed_captions(d, s, 3, 6)
    ]
    for kind in CREATURES:
        for deed in get_creature(kind).contents:
            found += [
                ("creatures", s, c)
                for s in TRAIN_STYLES
                for c in performed_captions(deed, s, 1, 4, subject=f"a {kind}")
            ]
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
    found += [("100style", s, c) for s in STYLES for c in capture_captions("walking forward", "going on foot", s)]
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
    assert len(every_caption()) > 5_000
    for name, style, caption in every_caption():
        neutral = to_neutral(caption)
        if style in PLAIN and ":" not in caption:
            assert neutral == caption, (name, caption, neutral)
        elif style not in PLAIN:
            assert tells(style).search(caption) or ":" in caption, (name, style, caption)
            assert not tells(style).search(neutral), (name, style, caption, neutral)
            assert neutral.count("neutrally") == 1, (name, caption, neutral)
        assert to_neutral(neutral) == neutral, (name, caption, neutral)


def test_to_neutral_keeps_what_is_done():
    for gait, (_, doing, again) in captures.GAITS.items():
        for name in FILES:
            for caption in captures.style100_labels(f"{name}_{gait}").texts:
                assert doing in to_neutral(caption) or again in to_neutral(caption), caption
    for style in captures.BANDAI_LABELS["bandai-2"]["style"].split():
        for caption in captures.bandai_labels(f"x_raise-up-left-hand_{style}_1").texts:
            assert re.search("(raising|lifting up) the left hand", to_neutral(caption)), caption


@pytest.mark.parametrize("style", STYLES)
def test_to_style_says_each_style(style):
    how, others = STYLES[style].how[0], [s for s in STYLES if s not in PLAIN]
    for n, (_, _, caption) in enumerate(every_caption()[::97]):
        there = to_style(to_neutral(caption), style)
        assert there.count(how) == 1, (style, caption, there)
        assert to_style(there, style) == there == to_style(caption, style)
        assert to_neutral(to_style(there, others[n % len(others)])) == to_style(there, "neutral")


@pytest.mark.parametrize("style", ["very-odd", "in_a_hurry", "tick and tock"])
def test_styles_without_words(style):
    there = to_style("a person walks, then jumps", style)
    assert there == f"a person walks, then jumps, in a{'n' * (style[0] in 'aeiou')} {style_phrase(style)} style"
    assert to_style(there, style) == there
    assert to_neutral("a person walks in a very odd style") == "a person walks neutrally"


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
def test_sentences_that_others_wrote(caption, neutral):
    assert to_neutral(caption) == neutral


def test_a_language_model_may_do_it():
    asked = []

    def ask(prompt: str) -> str:
        asked.append(prompt)
        return '\n "a person walks gloomily"\n'

    assert to_neutral("a person mopes about", ask) == "a person walks gloomily"
    assert to_style("a person mopes about", "old", ask=ask) == "a person walks gloomily"
    assert all(prompt.endswith("Sentence: a person mopes about") for prompt in asked)
    assert '"old"' in asked[1] and "in old age" in asked[1] and len(asked) == 2


@pytest.mark.parametrize("answer", ["", "  \n", "a person walks\nHope this helps!", None, '""'])
def test_answers_that_are_no_sentence(answer):
    for rewrite in (to_neutral, lambda caption, ask: to_style(caption, "old", ask)):
        with pytest.raises(mk.MotionKitError, match="was to answer with one sentence.*'a person walks'.*leave ask out"):
            rewrite("a person walks", lambda prompt: answer)
        with pytest.raises(mk.MotionKitError, match="the sentence is empty"):
            rewrite(" ", lambda prompt: "a person walks")
