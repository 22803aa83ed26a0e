"""The words of all data sets: how people speak of a style, and of what somebody does. A new one is a new line here.

Captions are made of these words (`actor.captions`, `datasets.captions`) and rewritten with them
(`captions.to_neutral`).
"""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..errors import MotionKitError


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


NEUTRAL = Words(
    ("neutrally", "normally", "in an ordinary way", "in a normal way", "in a neutral way"),
    captured=("in an ordinary way", ""),
)
_OLD = Words(
    ("in old age", "like an old person", "as old people do", "with the stiffness of age"),
    ("old", "elderly", "aged"),
    ("shuffle", "hobble"),
    ("as old people do", "old"),
)
_MASCULINE = Words(
    ("in a masculine way", "in a manly manner"), ("masculine", "manly"), captured=("in a manly manner", "masculine")
)


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


# The performer's styles, then those that only captures have.
STYLES = {
    "neutral": NEUTRAL,
    "angry": Words(
        ("in anger", "angrily", "furiously", "in a rage"),
        ("angry", "furious"),
        ("stomp", "storm"),
        ("furiously", "angry"),
    ),
    "childlike": Words(
        ("in a childlike way", "playfully", "like a child", "as a child would"),
        ("childlike", "playful", "childish"),
        ("toddle", "scamper"),
        ("as a child would", "childlike"),
    ),
    "depressed": Words(
        ("in depression", "dejectedly", "gloomily", "with a heavy heart"),
        ("depressed", "dejected"),
        ("trudge",),
        ("dejectedly", "depressed"),
    ),
    "old": _OLD,
    "proud": Words(
        ("in pride", "proudly", "with the head held high"), ("proud", "dignified"), ("stride",), ("proudly", "proud")
    ),
    "strutting": Words(
        ("in a strut", "with a swagger", "boastfully", "like a show-off"),
        ("strutting", "swaggering"),
        ("strut", "swagger"),
        ("with a swagger", "swaggering"),
    ),
    "tired": Words(
        ("in weariness", "wearily", "tiredly", "with heavy limbs"), ("tired", "weary"), ("plod",), ("wearily", "tired")
    ),
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
    "active": Words(
        ("in high spirits", "energetically", "with a lot of energy"),
        ("active", "energetic"),
        captured=("with a lot of energy", "active"),
    ),
    "childish": Words(("in a childish way",), ("childish",), captured=("as a child would", "childish")),
    "chimpira": Words(
        ("in the manner of a thug", "like a small-time gangster"),
        ("thuggish",),
        captured=("like a small-time gangster", "thuggish"),
    ),
    "elderly": _OLD._replace(captured=("as old people do", "elderly")),
    "exhausted": Words(
        ("in exhaustion", "with the last of their strength"),
        ("exhausted", "worn-out"),
        captured=("with the last of their strength", "exhausted"),
    ),
    "feminine": Words(
        ("in a feminine way", "in a ladylike manner"),
        ("feminine", "ladylike"),
        captured=("in a ladylike manner", "feminine"),
    ),
    "giant": Words(
        ("in the manner of a giant", "as if huge and heavy"),
        ("gigantic",),
        captured=("as if huge and heavy", "gigantic"),
    ),
    "happy": Words(("in happiness", "happily", "joyfully"), ("happy", "joyful"), captured=("joyfully", "happy")),
    "masculine": _MASCULINE,
    "masculinity": _MASCULINE,
    "musical": Words(("in a musical way", "as if to music"), ("musical",), captured=("as if to music", "musical")),
    "normal": NEUTRAL,
    "not-confident": Words(("in self-doubt", "timidly"), ("shy",), captured=("timidly", "shy")),
    "sad": Words(("in sadness", "sadly", "sorrowfully"), ("sad", "sorrowful"), captured=("sorrowfully", "sad")),
    "sexy": Words(("in a sexy way", "seductively"), ("sexy", "seductive"), captured=("seductively", "sexy")),
    "youthful": Words(
        ("in a youthful way", "as young people do"),
        ("youthful", "young"),
        captured=("as young people do", "youthful"),
    ),
}

# The other styles of 100STYLE, and how somebody moves who has one; its captions say "in a big steps style".
_LOCOMOTION = {
    "aeroplane": "like an aeroplane",
    "akimbo": "with arms akimbo",
    "arms-above-head": "with the arms above the head",
    "arms-behind-back": "with the arms behind the back",
    "arms-by-side": "with the arms by the side",
    "arms-folded": "with folded arms",
    "balance": "as if on a tightrope",
    "beat-chest": "with fists beating the chest",
    "bent-forward": "with the trunk bent forward",
    "bent-knees": "with bent knees",
    "big-steps": "with big steps",
    "bouncy-left": "with a bounce on the left leg",
    "bouncy-right": "with a bounce on the right leg",
    "cat": "like a cat",
    "chicken": "like a chicken",
    "cross-over": "with the legs crossing over",
    "crouched": "in a crouch",
    "crowd-avoidance": "as if through a crowd",
    "dinosaur": "like a dinosaur",
    "drag-left-leg": "with the left leg dragging",
    "drag-right-leg": "with the right leg dragging",
    "duck-foot": "with the toes turned out",
    "elated": "in elation",
    "fairy-steps": "with tiny steps",
    "flapping": "with flapping arms",
    "flick-legs": "with flicks of the legs",
    "followed": "as if followed",
    "graceful-arms": "with graceful arms",
    "hands-between-legs": "with the hands between the legs",
    "hands-in-pockets": "with the hands in the pockets",
    "heavyset": "as if heavyset",
    "high-knees": "with high knees",
    "in-the-dark": "as if in the dark",
    "karate-chop": "with karate chops",
    "kick": "with a kick at each step",
    "lawn-mower": "as if behind a lawn mower",
    "lean-back": "with the trunk leaning back",
    "lean-left": "with the trunk leaning left",
    "lean-right": "with the trunk leaning right",
    "left-hop": "in hops on the left leg",
    "legs-apart": "with the legs apart",
    "limp-left": "with a limp on the left leg",
    "limp-right": "with a limp on the right leg",
    "look-up": "with the eyes on the sky",
    "lunge": "in lunges",
    "march": "in a march",
    "monk": "like a monk",
    "morris": "like a morris dancer",
    "on-heels": "on the heels",
    "on-phone-left": "with a phone at the left ear",
    "on-phone-right": "with a phone at the right ear",
    "on-toes-bent-forward": "on the toes with the trunk bent forward",
    "on-toes-crouched": "on the toes in a crouch",
    "pendulum-hands": "with the hands like a pendulum",
    "penguin": "like a penguin",
    "pigeon-toed": "with the toes turned in",
    "punch": "with a punch at each step",
    "quail": "like a quail",
    "raised-left-arm": "with the left arm raised",
    "raised-right-arm": "with the right arm raised",
    "right-hop": "in hops on the right leg",
    "roadrunner": "like a roadrunner",
    "rocket": "like a rocket",
    "rushed": "in a rush",
    "shielded-left": "with the left arm as a shield",
    "shielded-right": "with the right arm as a shield",
    "skip": "in skips",
    "slide-feet": "with sliding feet",
    "spin-anti-clock": "in anticlockwise spins",
    "spin-clock": "in clockwise spins",
    "star": "with the limbs spread like a star",
    "start-stop": "in fits and starts",
    "stiff": "with stiff limbs",
    "superman": "like a superhero in flight",
    "swat": "as if swatting flies",
    "sweep": "as if sweeping the floor",
    "swimming": "as if swimming",
    "swing-arms-round": "with the arms swinging round",
    "swing-shoulders": "with swinging shoulders",
    "teapot": "like a teapot",
    "tiptoe": "on tiptoe",
    "together-step": "with the feet together at each step",
    "two-foot-jump": "in jumps with both feet",
    "walking-stick-left": "with a walking stick in the left hand",
    "walking-stick-right": "with a walking stick in the right hand",
    "waving": "with waves at everyone",
    "whirl-arms": "with whirling arms",
    "wide-legs": "with wide legs",
    "wiggle-hips": "with wiggling hips",
    "wild-arms": "with wild arms",
    "wild-legs": "with wild legs",
}
STYLES.update((name, Words((f"in {with_article(style_phrase(name))} style", how))) for name, how in _LOCOMOTION.items())

CONTENTS = {
    "bow": ContentWords(("{bow}", "{take} a bow", "{bend} down in a bow"), ("{bow}", "{bend} down in a greeting")),
    "bye": ContentWords((), ("{wave} goodbye", "{say} goodbye with a wave")),
    "byebye": ContentWords((), ("{wave} goodbye again and again", "{wave} someone off")),
    "call": ContentWords((), ("{call} someone over", "{beckon}")),
    "dance-long": ContentWords((), ("{dance} for a while", "{do} a long dance")),
    "dance-short": ContentWords((), ("{dance}", "{do} a short dance")),
    "dash": ContentWords((), ("{dash}", "{sprint}")),
    "guide": ContentWords((), ("{show} the way", "{point} someone along")),
    "idle": ContentWords(("{stand}", "{stand} in place", "{stand} around", "{wait}"), ("{stand}", "{stay} in place")),
    "jump": ContentWords(("{jump}", "{jump} up", "{leap} into the air"), ("{jump}", "{leap} up")),
    "kick": ContentWords(("{kick}%", "{throw} a kick%"), ("{kick}", "{throw} a kick")),
    "peck": ContentWords(("{peck}", "{peck} at the ground")),
    "punch": ContentWords(("{punch}", "{punch} with both fists", "{throw} punches"), ("{punch}", "{throw} a punch")),
    "raise-hands": ContentWords(("{raise} both hands", "{lift} both arms", "{put} both hands up")),
    "respond": ContentWords((), ("{respond}", "{answer} with a gesture")),
    "roar": ContentWords(("{roar}", "{roar} loudly")),
    "run": ContentWords(("{run}", "{run} forward", "{run} ahead", "{jog} along"), ("{run}", "{jog} along")),
    "sit": ContentWords(("{sit} down", "{sit}")),
    "slash": ContentWords((), ("{slash} with a sword", "{swing} a blade")),
    "threat": ContentWords(("{threaten} someone", "{raise} both claws")),
    "trot": ContentWords(("{trot}", "{trot} forward", "{trot} ahead", "{trot} along")),
    "walk": ContentWords(("{walk}", "{walk} forward", "{walk} ahead", "{walk} along"), ("{walk}", "{go} on foot")),
    "walk-back": ContentWords(
        ("{walk} backwards", "{walk} back", "{step} backwards"), ("{walk} backwards", "{step} back")
    ),
    "walk-left": ContentWords((), ("{walk} to the left", "{step} to the left")),
    "walk-right": ContentWords((), ("{walk} to the right", "{step} to the right")),
    "walk-turn-left": ContentWords(
        ("{walk} and {turn} left", "{walk} in a curve to the left", "{walk} and {veer} left"),
        ("{walk} and {turn} left", "{take} a left turn on foot"),
    ),
    "walk-turn-right": ContentWords(
        ("{walk} and {turn} right", "{walk} in a curve to the right", "{walk} and {veer} right"),
        ("{walk} and {turn} right", "{take} a right turn on foot"),
    ),
    "wave": ContentWords(("{wave}%", "{wave} at someone%", "{wave} hello%")),
}
_PAST = {
    "bend": "bent", "bite": "bit", "creep": "crept", "fly": "flew", "go": "went", "put": "put", "rise": "rose",
    "run": "ran", "say": "said", "sit": "sat", "stand": "stood", "stride": "strode", "strike": "struck",
    "swing": "swung", "take": "took", "throw": "threw",
}  # fmt: skip


def content_words(content: str) -> ContentWords:
    """The words for a content; none where nobody wrote any.

    >>> content_words("walk_back").captured, content_words("juggle")
    (('{walk} backwards', '{step} back'), ContentWords(ways=(), captured=()))
    """
    return CONTENTS.get(content.replace("_", "-"), ContentWords())


def conjugate(way: str, ending: str) -> str:
    """What is done, its verbs with `s`, `ing` or `ed`.

    >>> conjugate("{walk} and {turn} left", "ing")
    'walking and turning left'
    """
    return re.sub(r"{(\w+)}", lambda found: form(found[1], ending), way)


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
    told = _DESCRIBED.sub(r"\1 neutrally", caption)
    text, found = _HOW.sub("neutrally", told), told != caption
    found |= text != told
    for pattern, instead in ((_WHO, _plain_subject), (_LABELLED, _plain_subject), (_WALKS, _plain_walk)):
        text, count = pattern.subn(instead, text)
        found |= count > 0
    return _once(text, "neutrally") if found else caption


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
    said_here = [found for found in phrases if _says(prompt, found[2])]
    styles = [found for found in said_here if not _says(plain, found[2])]  # "a person is waving": a deed, no style
    if not styles and (so := _SO.search(prompt)):
        return so[1]
    return max(styles or said_here)[1]


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
    fitting = article if article.lower() == "the" else with_article(noun).split(" ")[0]
    return f"{fitting.capitalize() if article[0].isupper() else fitting} {noun}"


def _plain_walk(match: re.Match) -> str:
    return form("walk", _ENDINGS[match[0].lower()])


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


_LIMBS = {"kick": "leg", "wave": "hand"}


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
    if not isinstance(count, int) or count < 1:
        raise MotionKitError(f"count: expected a whole number of at least 1; found {count!r}")
    chance = random.Random(f"{seed} {content} {_name(style)}")
    words = _words(_name(style))
    subject = re.sub("^an? (.*)", lambda m: with_article(m[1]), subject)
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


def _name(style: object) -> str:
    """The name that has words: of "old x 1.5" it is "old", and at no strength or the opposite one "neutral"."""
    name, _, strength = getattr(style, "name", style).partition(" x ")
    return "neutral" if strength and float(strength) <= 0 else name


def _words(style: str) -> Words:
    return STYLES.get(style) or Words((f"in {with_article(style_phrase(style))} style",))


def _ways(content: str | Sequence[str], acts: Sequence) -> list[list[str]]:
    """For each content what is done, in several ways, verbs in braces."""
    names = content.split(",") if isinstance(content, str) else content
    result = []
    for name in (n.strip() for n in names):
        verb, *rest = re.split("[-_ ]+", name)
        sides = {act.side for act in acts if act.name == name}
        limb = f" with the {'left' if sides == {1} else 'right'} {_LIMBS.get(name)}" if len(sides) == 1 else ""
        words = content_words(name)
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
        who = chance.choice((with_article(who), f"the {who}"))
    if form == "walks":
        after = chance.choice(("", f" {adverb}")) if adverb[:4] not in ("", walk[:4]) else ""
        doing = [d.replace("{walk}", f"{{{walk}}}{after}") for d in doing]
    told = f"{adverb} " * (form == "adverb") + _doing(doing, ending) + f"{_comma(ways)} {how}" * (form == "how")
    return f"{who} {'is ' if ending == 'ing' else ''}{told}"


def _doing(doing: Sequence[str], ending: str) -> str:
    told = [conjugate(d, ending) for d in doing]
    return (" and then " if len(told) == 2 else ", then ").join(told)


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
