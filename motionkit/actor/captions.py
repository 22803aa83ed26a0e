"""Sentences about a performance, and the two rewrites of them that paper 1 needs: to neutral, and to a style.

The words are in two tables, `STYLES` and `CONTENTS`; a new style or content is a new line there.
"""

from __future__ import annotations

import random
import re
from collections.abc import Sequence
from typing import NamedTuple

from ..errors import MotionKitError
from .score import Act
from .style import Style, nearest


class Words(NamedTuple):
    """How people speak of a style.

    how: phrases that follow a verb, the one in paper 1's form first. who: what they call a person who moves so. walks:
    verbs that say "walk" and the style at once.
    """

    how: tuple[str, ...]
    who: tuple[str, ...] = ()
    walks: tuple[str, ...] = ()


_NEUTRAL = Words(("neutrally", "normally", "in an ordinary way", "in a normal way", "in a neutral way"))
_OLD = Words(
    ("in old age", "like an old person", "as old people do", "with the stiffness of age"),
    ("old", "elderly", "aged"),
    ("shuffle", "hobble"),
)

# The performer's styles, then those that only captures have.
STYLES = {
    "neutral": _NEUTRAL,
    "angry": Words(("in anger", "angrily", "furiously", "in a rage"), ("angry", "furious"), ("stomp", "storm")),
    "childlike": Words(
        ("in a childlike way", "playfully", "like a child", "as a child would"),
        ("childlike", "playful", "childish"),
        ("toddle", "scamper"),
    ),
    "depressed": Words(
        ("in depression", "dejectedly", "gloomily", "with a heavy heart"), ("depressed", "dejected"), ("trudge",)
    ),
    "old": _OLD,
    "proud": Words(("in pride", "proudly", "with the head held high"), ("proud", "dignified"), ("stride",)),
    "strutting": Words(
        ("in a strut", "with a swagger", "boastfully", "like a show-off"),
        ("strutting", "swaggering"),
        ("strut", "swagger"),
    ),
    "tired": Words(("in weariness", "wearily", "tiredly", "with heavy limbs"), ("tired", "weary"), ("plod",)),
    "sneaky": Words(
        ("in a sneaky way", "sneakily", "stealthily", "like a thief"), ("sneaky", "stealthy"), ("sneak", "creep")
    ),
    "drunk": Words(
        ("in drunkenness", "drunkenly", "unsteadily", "like a drunkard"), ("drunk", "tipsy"), ("stagger", "stumble")
    ),
    "robot": Words(
        ("in a robotic way", "robotically", "mechanically", "like a robot"), ("robotic", "mechanical", "robot-like")
    ),
    "zombie": Words(
        ("in a zombie-like way", "like a zombie", "as if undead"), ("zombie-like", "undead"), ("lurch", "shamble")
    ),
    "active": Words(("in high spirits", "energetically", "with a lot of energy"), ("active", "energetic")),
    "elderly": _OLD,
    "exhausted": Words(("in exhaustion", "with the last of their strength"), ("exhausted", "worn-out")),
    "feminine": Words(("in a feminine way", "in a ladylike manner"), ("feminine", "ladylike")),
    "happy": Words(("in happiness", "happily", "joyfully"), ("happy", "joyful")),
    "masculine": Words(("in a masculine way", "in a manly manner"), ("masculine", "manly")),
    "normal": _NEUTRAL,
    "sad": Words(("in sadness", "sadly", "sorrowfully"), ("sad", "sorrowful")),
    "sexy": Words(("in a sexy way", "seductively"), ("sexy", "seductive")),
    "youthful": Words(("in a youthful way", "as young people do"), ("youthful", "young")),
}

# What is done, in several ways. {verb}: to be put into its form. %: "with the left leg", where it is one leg or hand.
CONTENTS = {
    "walk": ("{walk}", "{walk} forward", "{walk} ahead", "{walk} along"),
    "walk_turn_left": ("{walk} and {turn} left", "{walk} in a curve to the left", "{walk} and {veer} left"),
    "walk_turn_right": ("{walk} and {turn} right", "{walk} in a curve to the right", "{walk} and {veer} right"),
    "walk_back": ("{walk} backwards", "{walk} back", "{step} backwards"),
    "run": ("{run}", "{run} forward", "{run} ahead", "{jog} along"),
    "jump": ("{jump}", "{jump} up", "{leap} into the air"),
    "kick": ("{kick}%", "{throw} a kick%"),
    "punch": ("{punch}", "{punch} with both fists", "{throw} punches"),
    "wave": ("{wave}%", "{wave} at someone%", "{wave} hello%"),
    "raise_hands": ("{raise} both hands", "{lift} both arms", "{put} both hands up"),
    "bow": ("{bow}", "{take} a bow", "{bend} down in a bow"),
    "idle": ("{stand}", "{stand} in place", "{stand} around", "{wait}"),
    "peck": ("{peck}", "{peck} at the ground"),
    "roar": ("{roar}", "{roar} loudly"),
    "sit": ("{sit} down", "{sit}"),
    "threat": ("{threaten} someone", "{raise} both claws"),
    "trot": ("{trot}", "{trot} forward", "{trot} ahead", "{trot} along"),
}
_LIMBS = {"kick": "leg", "wave": "hand"}
_PAST = {
    "bend": "bent", "bite": "bit", "creep": "crept", "fly": "flew", "go": "went", "put": "put", "rise": "rose",
    "run": "ran", "sit": "sat", "stand": "stood", "stride": "strode", "strike": "struck", "swing": "swung",
    "take": "took", "throw": "threw",
}  # fmt: skip


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
    subject = re.sub("^an? (.*)", lambda m: _a(m[1]), subject)
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


def to_neutral(caption: str) -> str:
    """The sentence with its words of style replaced by "neutrally" (paper 1, section 3.4: from d^s to d^(s-n)).

    What is done stays; a caption that says nothing of a style stays as it is. Only words in `STYLES` are known, and
    adjectives count only for the subject: who carries an old box may be young.

    >>> to_neutral("A person walks in depression.")
    'A person walks neutrally.'
    >>> to_neutral("an old person shuffles forward"), to_neutral("a person carries an old box")
    ('a person walks forward neutrally', 'a person carries an old box')
    """
    text, said = _HOW.sub("neutrally", caption), 0
    said += text != caption
    text, found = _WHO.subn(_plain_subject, text)
    said += found
    text, found = _WALKS.subn(lambda m: _form("walk", _ENDINGS[m[0].lower()]), text)
    said += found
    if not said:
        return caption
    return _once(text, "neutrally")


def to_style(caption: str, style: str) -> str:
    """The sentence in a style (paper 1, section 3.4: from D^c to D^(c,s)), as paper 1 words it.

    A style that it speaks of already is replaced. style: one of `STYLES`; MotionKitError names the nearest.

    >>> to_style("A person jumps neutrally.", "depressed"), to_style("a person walks", "old")
    ('A person jumps in depression.', 'a person walks in old age')
    """
    if style not in STYLES:
        raise MotionKitError(f"no words for style {style!r}; {nearest(style, STYLES)}; add a line to captions.STYLES")
    return _once(to_neutral(caption), STYLES[style].how[0])


def _once(text: str, how: str) -> str:
    """The sentence with the first of its neutral phrases put as `how` and the others left out; at its end if none."""
    text = _PLAINS.sub(r"\1", text)
    text = _EARLY.sub(r"\1", text)  # "a person neutrally walks": it reads better at the end
    if _PLAIN.search(text):
        text = _PLAIN.sub("", _PLAIN.sub("\0", text, 1)).replace("\0", how)
    else:
        comma = "," if re.search(r"\bthen\b", text) else ""  # all of it is done so, not the last alone
        text = re.sub(r"\s*([.!]?)\s*$", rf"{comma} {how}\1", text, count=1)
    return re.sub(r"\s+([,.!]|$)", r"\1", re.sub(r"  +", " ", text))


def _name(style: str | Style) -> str:
    """The name that has words: of "old x 1.5" it is "old", and at no strength or the opposite one "neutral"."""
    name, _, strength = getattr(style, "name", style).partition(" x ")
    return "neutral" if strength and float(strength) <= 0 else name


def _words(style: str) -> Words:
    said = re.sub("[-_]+", " ", style)
    return STYLES.get(style) or Words((f"in {_a(said)} style",))


def _ways(content: str | Sequence[str], acts: Sequence[Act]) -> list[list[str]]:
    """For each content what is done, in several ways, verbs in braces."""
    names = content.split(",") if isinstance(content, str) else content
    result = []
    for name in (n.strip() for n in names):
        verb, *rest = re.split("[-_ ]+", name)
        sides = {act.side for act in acts if act.name == name}
        limb = f" with the {'left' if sides == {1} else 'right'} {_LIMBS.get(name)}" if len(sides) == 1 else ""
        ways = CONTENTS.get(name) or (" ".join((f"{{{verb}}}", *rest)),)
        result.append([way.replace("%", limb) for way in ways])
    return result


def _forms(words: Words, ways: list[list[str]]) -> list[str]:
    if words is _NEUTRAL:
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
        who = chance.choice((_a(who), f"the {who}"))
    if form == "walks":
        after = chance.choice(("", f" {adverb}")) if adverb[:4] not in ("", walk[:4]) else ""
        doing = [d.replace("{walk}", f"{{{walk}}}{after}") for d in doing]
    told = f"{adverb} " * (form == "adverb") + _doing(doing, ending) + f"{_comma(ways)} {how}" * (form == "how")
    return f"{who} {'is ' if ending == 'ing' else ''}{told}"


def _doing(doing: Sequence[str], ending: str) -> str:
    said = [re.sub(r"{(\w+)}", lambda m: _form(m[1], ending), d) for d in doing]
    return (" and then " if len(said) == 2 else ", then ").join(said)


def _comma(ways: Sequence) -> str:
    return "," if len(ways) > 1 else ""


def _form(verb: str, ending: str) -> str:
    """A verb with `s`, `ing` or `ed`.

    >>> [_form(verb, ending) for verb, ending in (("punch", "s"), ("jog", "ing"), ("wave", "ed"), ("run", "ed"))]
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


def _a(words: str) -> str:
    """The words with `a` or `an` in front."""
    return f"{'an' if words[:1].lower() in tuple('aeiou') else 'a'} {words}"


def _plain_subject(match: re.Match) -> str:
    article, noun = match[1], match[2]
    fitting = article if article.lower() == "the" else _a(noun).split(" ")[0]
    return f"{fitting.capitalize() if article[0].isupper() else fitting} {noun}"


def _any(phrases: set[str]) -> str:
    return "|".join(map(re.escape, sorted(phrases, key=lambda p: (-len(p), p))))


_STYLED = [words for words in STYLES.values() if words is not _NEUTRAL]
_ADJECTIVES = _any({who for words in _STYLED for who in words.who})
_VERY = r"(?:(?:very|rather|quite|really|so) )?"
_MANY = rf"(?:{_VERY}(?:{_ADJECTIVES}),? (?:and )?)+"
# Phrases of manner, whole words; "in an angry way" is made of what people of a style are called.
_HOW = re.compile(
    rf"\b{_VERY}(?:{_any({how for words in _STYLED for how in words.how})}"
    rf"|in an? {_VERY}(?:{_ADJECTIVES}) (?:way|manner|style|mood)|in an? [\w-]+ style"
    rf"|like an? {_MANY}(?:person|man|woman|one))\b",
    re.IGNORECASE,
)
# Adjectives of the subject, which is where a sentence begins.
_WHO = re.compile(rf"^(an?|the) {_MANY}(\w+)", re.IGNORECASE)
_ENDINGS = {_form(v, e): e for words in _STYLED for v in words.walks for e in ("s", "ing", "ed")}
# "with long strides" and "a stumble" are no verbs
_WALKS = re.compile(rf"(?<!\blong )(?<!\bwith )(?<!\ba )(?:\b(?:{_any(set(_ENDINGS))})\b)", re.IGNORECASE)
_PLAIN = re.compile(rf"\b(?:{_any(set(_NEUTRAL.how))})\b", re.IGNORECASE)
_PLAINS = re.compile(rf"({_PLAIN.pattern})(?:,?(?: and)? {_PLAIN.pattern})+", re.IGNORECASE)
_EARLY = re.compile(
    rf"^((?:someone|somebody|he|she|they|(?:an?|the) \w+) (?:(?:is|was) )?){_PLAIN.pattern} ", re.IGNORECASE
)
