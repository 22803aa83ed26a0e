"""The words of all data sets: how people speak of a style, and of what somebody does. A new one is a new line here.

Captions are made of these words (`actor.captions`, `datasets.captions`) and rewritten with them (`text.to_neutral`).
"""

from __future__ import annotations

import re
from typing import NamedTuple


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


class Deed(NamedTuple):
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


def a(words: str) -> str:
    """The words with `a` or `an` in front.

    >>> a("person"), a("old person")
    ('a person', 'an old person')
    """
    return f"{'an' if words[:1].lower() in tuple('aeiou') else 'a'} {words}"


def said(name: str) -> str:
    """A label as people say it.

    >>> said("big-steps")
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
STYLES.update((name, Words((f"in {a(said(name))} style", how))) for name, how in _LOCOMOTION.items())

DEEDS = {
    "bow": Deed(("{bow}", "{take} a bow", "{bend} down in a bow"), ("{bow}", "{bend} down in a greeting")),
    "bye": Deed((), ("{wave} goodbye", "{say} goodbye with a wave")),
    "byebye": Deed((), ("{wave} goodbye again and again", "{wave} someone off")),
    "call": Deed((), ("{call} someone over", "{beckon}")),
    "dance-long": Deed((), ("{dance} for a while", "{do} a long dance")),
    "dance-short": Deed((), ("{dance}", "{do} a short dance")),
    "dash": Deed((), ("{dash}", "{sprint}")),
    "guide": Deed((), ("{show} the way", "{point} someone along")),
    "idle": Deed(("{stand}", "{stand} in place", "{stand} around", "{wait}"), ("{stand}", "{stay} in place")),
    "jump": Deed(("{jump}", "{jump} up", "{leap} into the air"), ("{jump}", "{leap} up")),
    "kick": Deed(("{kick}%", "{throw} a kick%"), ("{kick}", "{throw} a kick")),
    "peck": Deed(("{peck}", "{peck} at the ground")),
    "punch": Deed(("{punch}", "{punch} with both fists", "{throw} punches"), ("{punch}", "{throw} a punch")),
    "raise-hands": Deed(("{raise} both hands", "{lift} both arms", "{put} both hands up")),
    "respond": Deed((), ("{respond}", "{answer} with a gesture")),
    "roar": Deed(("{roar}", "{roar} loudly")),
    "run": Deed(("{run}", "{run} forward", "{run} ahead", "{jog} along"), ("{run}", "{jog} along")),
    "sit": Deed(("{sit} down", "{sit}")),
    "slash": Deed((), ("{slash} with a sword", "{swing} a blade")),
    "threat": Deed(("{threaten} someone", "{raise} both claws")),
    "trot": Deed(("{trot}", "{trot} forward", "{trot} ahead", "{trot} along")),
    "walk": Deed(("{walk}", "{walk} forward", "{walk} ahead", "{walk} along"), ("{walk}", "{go} on foot")),
    "walk-back": Deed(("{walk} backwards", "{walk} back", "{step} backwards"), ("{walk} backwards", "{step} back")),
    "walk-left": Deed((), ("{walk} to the left", "{step} to the left")),
    "walk-right": Deed((), ("{walk} to the right", "{step} to the right")),
    "walk-turn-left": Deed(
        ("{walk} and {turn} left", "{walk} in a curve to the left", "{walk} and {veer} left"),
        ("{walk} and {turn} left", "{take} a left turn on foot"),
    ),
    "walk-turn-right": Deed(
        ("{walk} and {turn} right", "{walk} in a curve to the right", "{walk} and {veer} right"),
        ("{walk} and {turn} right", "{take} a right turn on foot"),
    ),
    "wave": Deed(("{wave}%", "{wave} at someone%", "{wave} hello%")),
}
_PAST = {
    "bend": "bent", "bite": "bit", "creep": "crept", "fly": "flew", "go": "went", "put": "put", "rise": "rose",
    "run": "ran", "say": "said", "sit": "sat", "stand": "stood", "stride": "strode", "strike": "struck",
    "swing": "swung", "take": "took", "throw": "threw",
}  # fmt: skip


def deed(content: str) -> Deed:
    """The words for a content; none where nobody wrote any.

    >>> deed("walk_back").captured, deed("juggle")
    (('{walk} backwards', '{step} back'), Deed(ways=(), captured=()))
    """
    return DEEDS.get(content.replace("_", "-"), Deed())


def spoken(way: str, ending: str) -> str:
    """What is done, its verbs with `s`, `ing` or `ed`.

    >>> spoken("{walk} and {turn} left", "ing")
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
