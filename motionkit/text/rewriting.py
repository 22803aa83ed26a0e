"""Two rewrites of a sentence about a motion that paper 1 needs: to neutral, and to a style."""

from __future__ import annotations

import re
from collections.abc import Callable

from ..errors import MotionKitError
from .words import NEUTRAL, STYLES, Words, a, form, said

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
    (`text.words.STYLES`) and "in a ... style"; adjectives count only for the subject: who carries an old box may be
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
    told = _DESCRIBED.sub(r"\1 neutrally", caption)
    text, found = _HOW.sub("neutrally", told), told != caption
    found |= text != told
    for pattern, instead in ((_WHO, _plain_subject), (_LABELLED, _plain_subject), (_WALKS, _plain_walk)):
        text, count = pattern.subn(instead, text)
        found |= count > 0
    return _once(text, "neutrally") if found else caption


def to_style(caption: str, style: str, ask: Callable[[str], str] | None = None) -> str:
    """The sentence in a style (paper 1, section 3.4: from D^c to D^(c,s)), as paper 1 words it.

    A style that it speaks of already is replaced. style: a label; one without words in `text.words.STYLES` is put as
    "in a ... style". ask: a language model that does it instead, from a prompt to its answer. Raises MotionKitError for
    a caption or style that is no text, an empty style, and an answer that is not one sentence.

    >>> to_style("A person jumps neutrally.", "depressed"), to_style("a person walks", "very-odd")
    ('A person jumps in depression.', 'a person walks in a very odd style')
    """
    _check_caption(caption)
    if not isinstance(style, str) or not said(style):
        raise MotionKitError(f"style: expected a label, such as 'old'; found {style!r}")
    how = STYLES[style].how[0] if style in STYLES else f"in {a(said(style))} style"
    if ask is not None:
        return _answer(ask, _ASK_STYLE.format(style=said(style), how=how, caption=caption), caption)
    return _once(to_neutral(re.sub(rf"{re.escape(how)}(?!\w)", "neutrally", caption)), how)


def style_in(prompt: str) -> str:
    """The style that a sentence speaks of: a label of `text.words.STYLES`, or for others what "in a ... style" says.

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
    said_here = [found for found in phrases if _says(prompt, found[2])]
    styles = [found for found in said_here if not _says(plain, found[2])]  # "a person is waving": a deed, no style
    if not styles and (so := _SO.search(prompt)):
        return so[1]
    return max(styles or said_here)[1]


def _says(sentence: str, phrase: str) -> bool:
    return re.search(rf"\b{re.escape(phrase)}\b", sentence, re.IGNORECASE) is not None


def _phrases(name: str, words: Words) -> tuple[str, ...]:
    walks = [form(verb, ending) for verb in words.walks for ending in ("s", "ing", "ed")]
    return (*words.how, *words.captured[:1], *words.who, said(name), *walks)


def _check_caption(caption: object) -> None:
    if not isinstance(caption, str):
        raise MotionKitError(f"caption: expected a sentence; found {caption!r:.60}")


def _answer(ask: Callable[[str], str], prompt: str, caption: str) -> str:
    """What the language model says, if it is one line."""
    if not caption.strip():
        raise MotionKitError("caption: the sentence is empty; say what someone does, such as 'a person walks'")
    found = ask(prompt)
    lines = [line.strip() for line in found.splitlines() if line.strip()] if isinstance(found, str) else []
    told = lines[0].strip("\"'“”") if len(lines) == 1 else ""
    if not told:
        raise MotionKitError(
            f"the language model was to answer with one sentence, on one line; for {caption!r} it gave {found!r:.120}; "
            "ask another, or leave ask out"
        )
    return told


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
    fitting = article if article.lower() == "the" else a(noun).split(" ")[0]
    return f"{fitting.capitalize() if article[0].isupper() else fitting} {noun}"


def _plain_walk(match: re.Match) -> str:
    return form("walk", _ENDINGS[match[0].lower()])


def _any(phrases: set[str]) -> str:
    return "|".join(map(re.escape, sorted(phrases, key=lambda p: (-len(p), p))))


_STYLED = {name: words for name, words in STYLES.items() if words is not NEUTRAL}
_ADJECTIVES = _any({who for words in _STYLED.values() for who in words.who})
_LABELS = _any({said(name) for name in _STYLED})
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
