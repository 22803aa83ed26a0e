"""Sentences from labels, for captures that come without any.

The first has the form that paper 1 gave its style data (section 4.1): "a person is running in depression".
"""

from __future__ import annotations

import re

# For contents that published data sets name so: what someone is doing, twice in different words.
_DOING = {
    "bow": ("bowing", "bending down in a greeting"),
    "bye": ("waving goodbye", "saying goodbye with a wave"),
    "byebye": ("waving goodbye again and again", "waving someone off"),
    "call": ("calling someone over", "beckoning"),
    "dance-long": ("dancing for a while", "doing a long dance"),
    "dance-short": ("dancing", "doing a short dance"),
    "dash": ("dashing", "sprinting"),
    "guide": ("showing the way", "pointing someone along"),
    "idle": ("standing", "staying in place"),
    "jump": ("jumping", "leaping up"),
    "kick": ("kicking", "throwing a kick"),
    "punch": ("punching", "throwing a punch"),
    "respond": ("responding", "answering with a gesture"),
    "run": ("running", "jogging along"),
    "slash": ("slashing with a sword", "swinging a blade"),
    "walk": ("walking", "going on foot"),
    "walk-back": ("walking backwards", "stepping back"),
    "walk-left": ("walking to the left", "stepping to the left"),
    "walk-right": ("walking to the right", "stepping to the right"),
    "walk-turn-left": ("walking and turning left", "taking a left turn on foot"),
    "walk-turn-right": ("walking and turning right", "taking a right turn on foot"),
}

# For each style: how something is done, as paper 1 says it; the same in other words; who does it ("": leave it out).
_HOW = {
    "active": ("in high spirits", "with a lot of energy", "active"),
    "angry": ("in anger", "furiously", "angry"),
    "childish": ("in a childish way", "as a child would", "childish"),
    "childlike": ("in a childlike way", "as a child would", "childlike"),
    "chimpira": ("in the manner of a thug", "like a small-time gangster", "thuggish"),
    "depressed": ("in depression", "dejectedly", "depressed"),
    "elderly": ("in old age", "as old people do", "elderly"),
    "exhausted": ("in exhaustion", "with the last of their strength", "exhausted"),
    "feminine": ("in a feminine way", "in a ladylike manner", "feminine"),
    "giant": ("in the manner of a giant", "as if huge and heavy", "gigantic"),
    "happy": ("in happiness", "joyfully", "happy"),
    "masculine": ("in a masculine way", "in a manly manner", "masculine"),
    "masculinity": ("in a masculine way", "in a manly manner", "masculine"),
    "musical": ("in a musical way", "as if to music", "musical"),
    "neutral": ("neutrally", "in an ordinary way", ""),
    "normal": ("neutrally", "in an ordinary way", ""),
    "not-confident": ("in self-doubt", "timidly", "shy"),
    "old": ("in old age", "as old people do", "old"),
    "proud": ("in pride", "proudly", "proud"),
    "sad": ("in sadness", "sorrowfully", "sad"),
    "sexy": ("in a sexy way", "seductively", "sexy"),
    "strutting": ("in a strut", "with a swagger", "swaggering"),
    "tired": ("in weariness", "wearily", "tired"),
    "youthful": ("in a youthful way", "as young people do", "youthful"),
}


def doing(content: str) -> tuple[str, str]:
    """What someone "is doing" who does `content`, twice in different words.

    >>> doing("run"), doing("wave-left-hand"), doing("juggle")
    (('running', 'jogging along'), ('waving the left hand', 'swinging the left hand'),
     ('doing juggle', 'performing juggle'))
    """
    match = re.fullmatch(r"(wave|raise-up)-(both|left|right)-hands?", content)
    if match is None:
        words = re.sub("[-_]+", " ", content)
        return _DOING.get(content.replace("_", "-"), (f"doing {words}", f"performing {words}"))
    verb, again = {"wave": ("waving", "swinging"), "raise-up": ("raising", "lifting up")}[match[1]]
    hands = "both hands" if match[2] == "both" else f"the {match[2]} hand"
    return f"{verb} {hands}", f"{again} {hands}"


def captions(does: str, again: str, style: str) -> tuple[str, ...]:
    """At least four sentences for what someone does in a style, the one in paper 1's form first.

    does: what a person "is doing", such as `running`; again: the same in other words. style: a label; those that the
    published data sets use have words of their own. Without a style there are two sentences.

    >>> print(*captions("running", "jogging along", "depressed"), sep="\\n")
    a person is running in depression
    a person is jogging along dejectedly
    a depressed person is running
    someone is jogging along in a depressed way
    >>> captions("walking", "going on foot", "neutral")[2:]
    ('a person is walking', 'someone is going on foot in a neutral way')
    """
    if not style:
        return f"a person is {does}", f"someone is {again}"
    word = style.replace("-", " ").replace("_", " ").lower()
    how, other, who = _HOW.get(style, (f"in {_a(word)} style", f"the {word} way", word))
    who = who or word
    person = "person" if _HOW.get(style, ("", "", word))[2] == "" else f"{who} person"
    return (
        f"a person is {does} {how}",
        f"a person is {again} {other}",
        f"{_a(person)} is {does}",
        f"someone is {again} in {_a(who)} way",
    )


def _a(words: str) -> str:
    """The words with `a` or `an` in front."""
    return f"{'an' if words[:1].lower() in tuple('aeiou') else 'a'} {words}"
