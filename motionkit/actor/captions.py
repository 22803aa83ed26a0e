"""Sentences about a performance, made of the words in `text.words`."""

from __future__ import annotations

import random
import re
from collections.abc import Sequence

from ..errors import MotionKitError
from ..text.words import NEUTRAL, STYLES, Words, a, deed, said, spoken
from .score import Act
from .style import Style

_LIMBS = {"kick": "leg", "wave": "hand"}


def captions(
    content: str | Sequence[str],
    style: str | Style = "neutral",
    seed: int = 0,
    count: int = 4,
    *,
    subject: str = "a person",
    acts: Sequence[Act] = (),
) -> tuple[str, ...]:
    """Sentences that say who does what and how, all different; the first as paper 1 annotates (section 5.1).

    content: one, or several in a row. style: a name or a `Style`; where it has no words of its own, its name is used.
    seed: other sentences; the first stays. subject: who, with an article. acts: what happens (`Score.acts`), which
    tells the leg that kicks and the hand that waves. Raises MotionKitError if there are not so many sentences.

    >>> print(*captions("walk", "old", seed=1), sep="\\n")
    a person is walking in old age
    somebody shuffled along
    the person walks along as old people do
    an elderly person walks
    """
    if not isinstance(count, int) or count < 1:
        raise MotionKitError(f"count: expected a whole number of at least 1; found {count!r}")
    chance = random.Random(f"{seed} {content} {_name(style)}")
    words = _words(_name(style))
    subject = re.sub("^an? (.*)", lambda m: a(m[1]), subject)
    ways = _ways(content, acts)
    found = {f"{subject} is {_doing([w[0] for w in ways], 'ing')}{_comma(ways)} {words.how[0]}": None}
    forms = _forms(words, ways)
    chance.shuffle(forms)
    for n in range(50 * count):
        if len(found) >= count:
            break
        found[_sentence(forms[n % len(forms)], subject, ways, words, chance)] = None
    if len(found) < count:
        raise MotionKitError(f"count: there are {len(found)} sentences about {content!r}; found {count!r}")
    return tuple(found)


def _name(style: str | Style) -> str:
    """The name that has words: of "old x 1.5" it is "old", and at no strength or the opposite one "neutral"."""
    name, _, strength = getattr(style, "name", style).partition(" x ")
    return "neutral" if strength and float(strength) <= 0 else name


def _words(style: str) -> Words:
    return STYLES.get(style) or Words((f"in {a(said(style))} style",))


def _ways(content: str | Sequence[str], acts: Sequence[Act]) -> list[list[str]]:
    """For each content what is done, in several ways, verbs in braces."""
    names = content.split(",") if isinstance(content, str) else content
    result = []
    for name in (n.strip() for n in names):
        verb, *rest = re.split("[-_ ]+", name)
        sides = {act.side for act in acts if act.name == name}
        limb = f" with the {'left' if sides == {1} else 'right'} {_LIMBS.get(name)}" if len(sides) == 1 else ""
        words = deed(name)
        ways = words.ways or words.captured or (" ".join((f"{{{verb}}}", *rest)),)
        result.append([way.replace("%", limb) for way in ways])
    return result


def _forms(words: Words, ways: list[list[str]]) -> list[str]:
    if words is NEUTRAL:
        return ["plain", "how"]
    forms = ["how"] + ["who"] * bool(words.who) + ["adverb"] * bool(_adverbs(words))
    return forms + ["walks"] * (bool(words.walks) and any("{walk}" in w[0] for w in ways))


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
        who = chance.choice((a(who), f"the {who}"))
    if form == "walks":
        after = chance.choice(("", f" {adverb}")) if adverb[:4] not in ("", walk[:4]) else ""
        doing = [d.replace("{walk}", f"{{{walk}}}{after}") for d in doing]
    told = f"{adverb} " * (form == "adverb") + _doing(doing, ending) + f"{_comma(ways)} {how}" * (form == "how")
    return f"{who} {'is ' if ending == 'ing' else ''}{told}"


def _doing(doing: Sequence[str], ending: str) -> str:
    told = [spoken(d, ending) for d in doing]
    return (" and then " if len(told) == 2 else ", then ").join(told)


def _comma(ways: Sequence) -> str:
    return "," if len(ways) > 1 else ""
