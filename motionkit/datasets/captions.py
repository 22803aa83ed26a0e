"""Sentences from labels, for captures that come without any.

The first has the form that paper 1 gave its style data (section 4.1): "a person is running in depression".
"""

from __future__ import annotations

import re

from ..text.words import STYLES, Words, a, deed, spoken


def doing(content: str) -> tuple[str, str]:
    """What someone "is doing" who does `content`, twice in different words.

    >>> doing("run"), doing("wave-left-hand"), doing("juggle")
    (('running', 'jogging along'), ('waving the left hand', 'swinging the left hand'),
     ('doing juggle', 'performing juggle'))
    """
    match = re.fullmatch(r"(wave|raise-up)-(both|left|right)-hands?", content)
    if match is None:
        ways = deed(content).captured
        words = re.sub("[-_]+", " ", content)
        return tuple(spoken(way, "ing") for way in ways) if ways else (f"doing {words}", f"performing {words}")
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
    words = STYLES.get(style, Words(()))
    how, (other, who) = f"in {a(word)} style", words.captured or (f"the {word} way", word)
    person = f"{who} person" if who else "person"
    return (
        f"a person is {does} {words.how[0] if words.captured else how}",
        f"a person is {again} {other}",
        f"{a(person)} is {does}",
        f"someone is {again} in {a(who or word)} way",
    )
