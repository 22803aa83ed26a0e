"""Sentences that say what somebody does and in which style: made for clips, and rewritten to neutral and back.

All words are in `words.json`, beside this file; a new style or content is a new line there. Captions of the performer
(`performed_captions`) and of captures (`capture_captions`) are made of them, and `to_neutral`, `to_style` and
`style_in` know them again.
"""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from ..errors import MotionKitError, check


class Words(NamedTuple):
    """How people speak of a style.

    how: phrases that follow a verb, the one in paper 1's form first. who: what they call a person who moves so. walks:
    verbs that say "walk" and the style at once. captured: what captions of captures say beside the first of `how`: the
    same in other words, and what they call the person ("": a person); without it they say the style's name.
    """

    how: tuple[str, ...]
    who: tuple[str, ...] = ()
    walks: tuple[str, ...] = ()
    captured: tuple[str, str] | tuple[()] = ()


class ContentWords(NamedTuple):
    """What is done, verbs in braces, to be put into their form.

    ways: of captions of the performer; %: "with the left leg", where it is one leg or hand. captured: the two of
    captions of captures.
    """

    ways: tuple[str, ...] = ()
    captured: tuple[str, str] | tuple[()] = ()


def with_article(words: str) -> str:
    """The words with `a` or `an` in front.

    >>> with_article("person"), with_article("old person")
    ('a person', 'an old person')
    """
    return f"{'an' if words[:1].lower() in tuple('aeiou') else 'a'} {words}"


def style_phrase(name: str) -> str:
    """A label as people say it.

    >>> style_phrase("big-steps")
    'big steps'
    """
    return re.sub("[-_]+", " ", name).strip()


def form(verb: str, ending: str) -> str:
    """A verb with `s`, `ing` or `ed`.

    >>> [form(verb, ending) for verb, ending in (("punch", "s"), ("jog", "ing"), ("wave", "ed"), ("run", "ed"))]
    ['punches', 'jogging', 'waved', 'ran']
    """
    if ending == "s":
        return re.sub("([^aeiou])y$", r"\1ie", verb) + ("es" if re.search("(s|sh|ch|x|z|o)$", verb) else "s")
    if ending == "ed" and verb in _PAST:
        return _PAST[verb]
    if re.fullmatch("[^aeiou]*[aeiou][^aeiouwxy]", verb):
        return verb + verb[-1] + ending
    if ending == "ed":
        verb = re.sub("([^aeiou])y$", r"\1i", verb)
    return (verb[:-1] if re.search("[^eoy]e$", verb) or (ending == "ed" and verb[-1] == "e") else verb) + ending


def conjugate(way: str, ending: str) -> str:
    """What is done, its verbs with `s`, `ing` or `ed`.

    >>> conjugate("{walk} and {turn} left", "ing")
    'walking and turning left'
    """
    return re.sub(r"{(\w+)}", lambda found: form(found[1], ending), way)


_LEXICON = json.loads(Path(__file__).with_name("words.json").read_text(encoding="utf-8"))
_PAST = _LEXICON["past"]  # of verbs that do not end in -ed
_LIMBS = {"kick": "leg", "wave": "hand"}


def _read_styles() -> dict[str, Words]:
    """The performer's styles, those that only captures have, and the other styles of 100STYLE.

    A name in place of words: the words of that style. Captions of 100STYLE say "in a big steps style".
    """
    styles: dict[str, Words] = {}
    for name, words in _LEXICON["styles"].items():
        styles[name] = styles[words] if isinstance(words, str) else Words(**{k: tuple(v) for k, v in words.items()})
    for name, how in _LEXICON["locomotion"].items():
        styles[name] = Words((f"in {with_article(style_phrase(name))} style", how))
    return styles


STYLES = _read_styles()
NEUTRAL = STYLES["neutral"]
CONTENTS = {
    name: ContentWords(**{k: tuple(v) for k, v in words.items()}) for name, words in _LEXICON["contents"].items()
}


def content_words(content: str) -> ContentWords:
    """The words for a content; none where nobody wrote any.

    >>> content_words("walk_back").captured, content_words("juggle")
    (('{walk} backwards', '{step} back'), ContentWords(ways=(), captured=()))
    """
    return CONTENTS.get(content.replace("_", "-"), ContentWords())


def _any(phrases: set[str]) -> str:
    return "|".join(map(re.escape, sorted(phrases, key=lambda p: (-len(p), p))))


_STYLED = {name: words for name, words in STYLES.items() if words is not NEUTRAL}
_ADJECTIVES = _any({who for words in _STYLED.values() for who in words.who})
_LABELS = _any({style_phrase(name) for name in _STYLED})
_VERY = r"(?:(?:very|rather|quite|really|so) )?"
_MANY = rf"(?:{_VERY}(?:{_ADJECTIVES}),? (?:and )?)+"
# Phrases of manner, whole words; "in an angry way" is made of what people of a style are called. A style that nobody
# wrote words for is "in a very odd style".
_HOW = re.compile(
    rf"\b{_VERY}(?:in an? {_VERY}(?:{_ADJECTIVES}|{_LABELS}) (?:way|manner|style|mood)|the (?:{_LABELS}) way"
    rf"|{_any({how for words in _STYLED.values() for how in (*words.how, *words.captured[:1])})}"
    r"|in an? (?:(?!(?:in|an?|the|and|then)\b)[\w-]+ ){1,4}style"
    rf"|like an? {_MANY}(?:person|man|woman|one))\b",
    re.IGNORECASE,
)
_SO = re.compile(
    r"\bin an? ((?:(?!(?:in|an?|the|and|then)\b)[\w-]+ )*?[\w-]+) (?:style|way|manner|mood)\b", re.IGNORECASE
)
# Adjectives of the subject, which is where a sentence begins.
_WHO = re.compile(rf"^(an?|the) {_MANY}(\w+)", re.IGNORECASE)
# Labels count before these only: "a big steps person", but a cat is a cat.
_LABELLED = re.compile(rf"^(an?|the) (?:{_LABELS}) (person|man|woman|boy|girl)\b", re.IGNORECASE)
# "a person is walking: long strides", as captions of 100STYLE describe a style.
_DESCRIBED = re.compile(r"^(a person is [^:]+): .+$", re.IGNORECASE | re.DOTALL)
_ENDINGS = {form(v, e): e for words in _STYLED.values() for v in words.walks for e in ("s", "ing", "ed")}
# "with long strides" and "a stumble" are no verbs
_WALKS = re.compile(rf"(?<!\blong )(?<!\bwith )(?<!\ba )(?:\b(?:{_any(set(_ENDINGS))})\b)", re.IGNORECASE)
_PLAIN = re.compile(rf"\b(?:{_any(set(NEUTRAL.how))})\b", re.IGNORECASE)
_PLAINS = re.compile(rf"({_PLAIN.pattern})(?:,?(?: and)? {_PLAIN.pattern})+", re.IGNORECASE)
_EARLY = re.compile(
    rf"^((?:someone|somebody|he|she|they|(?:an?|the) \w+) (?:(?:is|was) )?){_PLAIN.pattern} ", re.IGNORECASE
)


_ASK_NEUTRAL = (
    "Rewrite the sentence so that it tells what is done and nothing of mood, age, character or manner of it; say "
    '"neutrally" instead. Keep all else. Answer with the one sentence alone.\nSentence: {caption}'
)
_ASK_STYLE = (
    'Rewrite the sentence so that what is done is done in the style "{style}", for example "{how}", in place of any '
    "other mood, age, character or manner. Keep all else. Answer with the one sentence alone.\nSentence: {caption}"
)


def to_neutral(caption: str, ask: Callable[[str], str] | None = None) -> str:
    """The sentence with its words of style replaced by "neutrally" (paper 1, section 3.4: from d^s to d^(s-n)).

    What is done stays; a caption that says nothing of a style stays as it is. Known are the words of all data sets
    (`captions.STYLES`) and "in a ... style"; adjectives count only for the subject: who carries an old box may be
    young. ask: a language model that does it instead, from a prompt to its answer. Raises MotionKitError for a caption
    that is no text, and for an answer that is not one sentence.

    >>> to_neutral("A person walks in depression.")
    'A person walks neutrally.'
    >>> to_neutral("an old person shuffles forward"), to_neutral("a person carries an old box")
    ('a person walks forward neutrally', 'a person carries an old box')
    """
    _check_caption(caption)
    if ask is not None:
        return _answer(ask, _ASK_NEUTRAL.format(caption=caption), caption)
    text, changes = caption, 0
    for pattern, plain in (
        (_DESCRIBED, r"\1 neutrally"),
        (_HOW, "neutrally"),
        (_WHO, _plain_subject),
        (_LABELLED, _plain_subject),
        (_WALKS, lambda verb: form("walk", _ENDINGS[verb[0].lower()])),
    ):
        text, count = pattern.subn(plain, text)
        changes += count
    return _once(text, "neutrally") if changes else caption


def to_style(caption: str, style: str, ask: Callable[[str], str] | None = None) -> str:
    """The sentence in a style (paper 1, section 3.4: from D^c to D^(c,s)), as paper 1 words it.

    A style that it speaks of already is replaced. style: a label; one without words in `captions.STYLES` is put as
    "in a ... style". ask: a language model that does it instead, from a prompt to its answer. Raises MotionKitError for
    a caption or style that is no text, an empty style, and an answer that is not one sentence.

    >>> to_style("A person jumps neutrally.", "depressed"), to_style("a person walks", "very-odd")
    ('A person jumps in depression.', 'a person walks in a very odd style')
    """
    _check_caption(caption)
    if not isinstance(style, str) or not style_phrase(style):
        raise MotionKitError(f"style: expected a label, such as 'old'; found {style!r}")
    how = STYLES[style].how[0] if style in STYLES else f"in {with_article(style_phrase(style))} style"
    if ask is not None:
        return _answer(ask, _ASK_STYLE.format(style=style_phrase(style), how=how, caption=caption), caption)
    return _once(to_neutral(re.sub(rf"{re.escape(how)}(?!\w)", "neutrally", caption)), how)


def style_in(prompt: str) -> str:
    """The style that a sentence speaks of: a label of `captions.STYLES`, or for others what "in a ... style" says.

    It is what `to_style` takes. Raises MotionKitError for a sentence that speaks of none.

    >>> style_in("an elderly man walks"), style_in("a person kicks in a very odd style")
    ('old', 'very odd')
    >>> style_in("a person walks")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: 'a person walks' says nothing of a style; ... 'a person walks in old age'...
    """
    plain = to_neutral(prompt)
    if plain == prompt or _PLAIN.search(prompt):
        raise MotionKitError(
            f"{prompt!r} says nothing of a style; say how it is done, such as 'a person walks in old age'; or, "
            "in words of your own, 'a person walks in a funky style'"
        )
    described = _DESCRIBED.match(prompt)
    if described:
        return prompt[described.end(1) :].strip(" :.")
    phrases = [(len(phrase), name, phrase) for name, words in _STYLED.items() for phrase in _phrases(name, words)]
    in_prompt = [row for row in phrases if _says(prompt, row[2])]
    styles = [row for row in in_prompt if not _says(plain, row[2])]  # "a person is waving": an act, no style
    if not styles and (so := _SO.search(prompt)):
        return so[1]
    return max(styles or in_prompt)[1]


def _says(sentence: str, phrase: str) -> bool:
    return re.search(rf"\b{re.escape(phrase)}\b", sentence, re.IGNORECASE) is not None


def _phrases(name: str, words: Words) -> tuple[str, ...]:
    walks = [form(verb, ending) for verb in words.walks for ending in ("s", "ing", "ed")]
    return (*words.how, *words.captured[:1], *words.who, style_phrase(name), *walks)


def _check_caption(caption: object) -> None:
    if not isinstance(caption, str):
        raise MotionKitError(f"caption: expected a sentence; found {caption!r:.60}")


def _answer(ask: Callable[[str], str], prompt: str, caption: str) -> str:
    """What the language model says, if it is one line."""
    if not caption.strip():
        raise MotionKitError("caption: the sentence is empty; say what someone does, such as 'a person walks'")
    answer = ask(prompt)
    lines = [line.strip() for line in answer.splitlines() if line.strip()] if isinstance(answer, str) else []
    sentence = lines[0].strip("\"'“”") if len(lines) == 1 else ""
    if not sentence:
        raise MotionKitError(
            f"the language model was to answer with one sentence, on one line; for {caption!r} it gave "
            f"{answer!r:.120}; ask another, or leave ask out"
        )
    return sentence


def _once(text: str, how: str) -> str:
    """The sentence with the first of its neutral phrases put as `how` and the others left out; at its end if none."""
    text = _PLAINS.sub(r"\1", text)
    text = _EARLY.sub(r"\1", text)  # "a person neutrally walks": it reads better at the end
    if _PLAIN.search(text):
        text = _PLAIN.sub("", _PLAIN.sub("\0", text, 1)).replace("\0", how)
    else:
        comma = "," if re.search(r"\bthen\b", text) else ""  # all of it is done so, not the last alone
        text = re.sub(r"\s*([.!]?)\s*$", lambda end: f"{comma} {how}{end[1]}", text, count=1)
    return re.sub(r"\s+([,.!]|$)", r"\1", re.sub(r"  +", " ", text))


def _plain_subject(match: re.Match) -> str:
    article, noun = match[1], match[2]
    fitting = article if article.lower() == "the" else with_article(noun).split(" ")[0]
    return f"{fitting.capitalize() if article[0].isupper() else fitting} {noun}"


def performed_captions(
    content: str | Sequence[str],
    style: object = "neutral",
    seed: int = 0,
    count: int = 4,
    *,
    subject: str = "a person",
    acts: Sequence = (),
) -> tuple[str, ...]:
    """Sentences that say who does what and how, all different; the first as paper 1 annotates (section 5.1).

    content: one, or several in a row. style: a name or an `actor.Style`; where it has no words of its own, its name is
    used. seed: other sentences; the first stays. subject: who, with an article. acts: what happens (`Score.acts`),
    which tells the leg that kicks and the hand that waves. Raises MotionKitError if there are not so many sentences.

    >>> print(*performed_captions("walk", "old", seed=1), sep="\\n")
    a person is walking in old age
    somebody shuffled along
    the person walks along as old people do
    an elderly person walks
    """
    check.number("count", count, 1, whole=True)
    name, _, strength = getattr(style, "name", style).partition(" x ")  # "old x 1.5" is told as "old"
    if strength and float(strength) <= 0:
        name = "neutral"
    chance = random.Random(f"{seed} {content} {name}")
    words = STYLES.get(name) or Words((f"in {with_article(style_phrase(name))} style",))
    subject = re.sub("^an? (.*)", lambda m: with_article(m[1]), subject)
    ways = _ways(content, acts)
    forms = ["how"] + ["who"] * bool(words.who) + ["adverb"] * bool(_adverbs(words))
    forms += ["walks"] * (bool(words.walks) and any("{walk}" in w[0] for w in ways))
    if words is NEUTRAL:
        forms = ["plain", "how"]
    chance.shuffle(forms)
    sentences = {f"{subject} is {_doing([w[0] for w in ways], 'ing')}{_comma(ways)} {words.how[0]}": None}
    for n in range(50 * count):
        if len(sentences) >= count:
            break
        sentences[_sentence(forms[n % len(forms)], subject, ways, words, chance)] = None
    if len(sentences) < count:
        raise MotionKitError(f"count: there are {len(sentences)} sentences about {content!r}; found {count!r}")
    return tuple(sentences)


def _ways(content: str | Sequence[str], acts: Sequence) -> list[list[str]]:
    """For each content what is done, in several ways, verbs in braces."""
    result = []
    for name in (n.strip() for n in (content.split(",") if isinstance(content, str) else content)):
        verb, *rest = re.split("[-_ ]+", name)
        sides = {act.side for act in acts if act.name == name}
        limb = f" with the {'left' if sides == {1} else 'right'} {_LIMBS.get(name)}" if len(sides) == 1 else ""
        words = content_words(name)
        ways = words.ways or words.captured or (" ".join((f"{{{verb}}}", *rest)),)
        result.append([way.replace("%", limb) for way in ways])
    return result


def _adverbs(words: Words) -> list[str]:
    return [how for how in words.how if " " not in how]


def _sentence(form: str, subject: str, ways: list[list[str]], words: Words, chance: random.Random) -> str:
    """One sentence. form: what tells the style: how it is done, who does it, an adverb, or a verb of walking."""
    if form == "walks":
        ways = [[w for w in several if "{walk}" in w] or several for several in ways]
    doing, ending = [chance.choice(w) for w in ways], chance.choice(("s", "ing", "ed"))
    noun = subject.split(" ", 1)[-1]
    who = chance.choice((subject, f"the {noun}", *(("someone", "somebody") if noun == "person" else ())))
    how, adverb, walk = (chance.choice(c) if c else "" for c in (words.how, _adverbs(words), words.walks))
    if form == "who":
        who = f"{chance.choice(words.who)} {noun}"
        who = chance.choice((with_article(who), f"the {who}"))
    if form == "walks":
        after = chance.choice(("", f" {adverb}")) if adverb[:4] not in ("", walk[:4]) else ""
        doing = [d.replace("{walk}", f"{{{walk}}}{after}") for d in doing]
    does = f"{adverb} " * (form == "adverb") + _doing(doing, ending) + f"{_comma(ways)} {how}" * (form == "how")
    return f"{who} {'is ' if ending == 'ing' else ''}{does}"


def _doing(doing: Sequence[str], ending: str) -> str:
    return (" and then " if len(doing) == 2 else ", then ").join(conjugate(d, ending) for d in doing)


def _comma(ways: Sequence) -> str:
    return "," if len(ways) > 1 else ""


def gerund(content: str) -> tuple[str, str]:
    """What someone "is doing" who does `content`, twice in different words.

    >>> gerund("run"), gerund("wave-left-hand"), gerund("juggle")
    (('running', 'jogging along'), ('waving the left hand', 'swinging the left hand'),
     ('doing juggle', 'performing juggle'))
    """
    match = re.fullmatch(r"(wave|raise-up)-(both|left|right)-hands?", content)
    if match is None:
        ways = content_words(content).captured
        words = re.sub("[-_]+", " ", content)
        return tuple(conjugate(way, "ing") for way in ways) if ways else (f"doing {words}", f"performing {words}")
    verb, again = {"wave": ("waving", "swinging"), "raise-up": ("raising", "lifting up")}[match[1]]
    hands = "both hands" if match[2] == "both" else f"the {match[2]} hand"
    return f"{verb} {hands}", f"{again} {hands}"


def capture_captions(does: str, again: str, style: str) -> tuple[str, ...]:
    """At least four sentences for what someone does in a style, the one in paper 1's form first.

    does: what a person "is doing", such as `running`; again: the same in other words. style: a label; those that the
    published data sets use have words of their own. Without a style there are two sentences.

    >>> print(*capture_captions("running", "jogging along", "depressed"), sep="\\n")
    a person is running in depression
    a person is jogging along dejectedly
    a depressed person is running
    someone is jogging along in a depressed way
    >>> capture_captions("walking", "going on foot", "neutral")[2:]
    ('a person is walking', 'someone is going on foot in a neutral way')
    """
    if not style:
        return f"a person is {does}", f"someone is {again}"
    word = style.replace("-", " ").replace("_", " ").lower()
    words = STYLES.get(style, Words(()))
    how, (other, who) = f"in {with_article(word)} style", words.captured or (f"the {word} way", word)
    person = f"{who} person" if who else "person"
    return (
        f"a person is {does} {words.how[0] if words.captured else how}",
        f"a person is {again} {other}",
        f"{with_article(person)} is {does}",
        f"someone is {again} in {with_article(who or word)} way",
    )
