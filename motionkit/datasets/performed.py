"""Data sets that the performer makes: `actor`, the default, `actor-unseen` with styles held back, `creatures`.

Nothing is downloaded. Contacts and phase of every clip are exact, and `motionkit.actor.retell` tells the exact answer
of any style transfer: the clip's own performance in another style. (Within a data set no take is in two styles.)
"""

from __future__ import annotations

import hashlib
import os
import random
from dataclasses import dataclass

import torch
from torch import Tensor

from .. import actor
from ..actor import CONTENTS, Performance, Performer, performing
from ..actor.performing import synthesize
from ..actor.score import GESTURES, WALK_RATE
from ..actor.style import HELD_OUT_STYLES, TRAIN_STYLES, get_style
from ..errors import MotionKitError
from ..text.captions import performed_captions
from .sources import Item, Labels, Recording

FPS, SHORTEST, LONGEST = 30.0, 4.0, 8.0  # seconds
# Who is in which part; the same in all data sets, so that nobody who is tested on was ever trained on.
PERFORMERS = {"train": range(44), "validation": range(44, 50), "test": range(50, 60)}
# Takes of each content in each style. Of an unseen style few-shot methods get two to learn from.
TAKES = {
    "actor": {"train": 12, "validation": 2, "test": 3},
    "actor-unseen": {"train": 2, "validation": 1, "test": 5},
    "actor-held-back": {"train": 12, "validation": 2, "test": 3},  # for judges alone
    "creatures": {"train": 3, "validation": 1, "test": 1},
}
STYLES = {"actor": TRAIN_STYLES, "actor-unseen": HELD_OUT_STYLES, "actor-held-back": ("neutral", *HELD_OUT_STYLES)}
_FIRST_SEED = {"actor": 0, "actor-unseen": 100_000, "creatures": 200_000, "actor-held-back": 300_000}


@dataclass(frozen=True)
class ActorSource:
    """A clip that the performer makes when it is asked for. seconds: how long. creature: its kind; none for people.

    >>> source = ActorSource("walk", "old", seed=3, performer=7, seconds=4.0)
    >>> source.read().motion
    Motion('walk_old_3', 120 frames at 30 fps, 4.0 s, 22 joints)
    """

    content: str
    style: str
    seed: int
    performer: int
    seconds: float
    creature: str = ""

    @property
    def state(self) -> str:
        """What is asked for, and the version of the performer."""
        wish = (self.creature, self.content, self.style, self.seed, self.performer, f"{self.seconds:.4f}")
        return " ".join(map(str, (actor.VERSION, *wish)))

    def perform(self) -> Performance:
        """The clip with all that is known of it; `motionkit.actor.retell` tells it in another style."""
        who = performing.get_creature(self.creature, self.performer) if self.creature else self.performer
        return actor.perform(self.content, self.style, self.seed, seconds=self.seconds, fps=FPS, performer=who)

    def read(self) -> Recording:
        """The motion, with contacts [F, K], and phase and beats [F, 1]; see `Performance`."""
        performance = self.perform()
        phase, beats = performance.phase[:, None], performance.beats[:, None]
        return Recording(performance.motion, {"contacts": performance.contacts, "phase": phase, "beats": beats})

    def positions(self) -> Tensor:
        """Where the joints are, [F, J, 3] metres, float64."""
        clip = self.perform()
        make = performing.synthesize_creature if self.creature else synthesize
        return make(clip.score, clip.style, clip.performer, FPS, len(clip))[0].positions()


def items(name: str = "actor", root: str | os.PathLike | None = None) -> list[Item]:
    """The clips of `actor`, `actor-unseen`, `actor-held-back` or `creatures`, nothing made yet; 4 to 8 s at 30 fps.

    `actor` has 17 takes of each of 12 contents in 8 styles: 12 to train on, 2 to validate with, 3 to test on, which
    others perform. `actor-unseen` has 8 (2, 1 and 5) in the 4 styles held back, by the same people; `actor-held-back`
    as many as `actor` of these and of neutral, so that judges of them can be trained; `creatures` 5 (3, 1 and 1) of
    all that each can do. root: must be left out. Raises MotionKitError if it is not.

    >>> clips = items("actor")
    >>> clips[0].name, clips[0].labels.texts[0], clips[0].labels.split
    ('bow_angry_00', 'a person is bowing in anger', 'train')
    """
    if root is not None:
        raise MotionKitError(f"dataset {name!r} is made here, not read; leave root={os.fspath(root)!r} out")
    if name == "creatures":
        kinds = [(c, content) for c in performing.CREATURES for content in performing.get_creature(c).contents]
        clips = [(creature, content, style) for creature, content in kinds for style in TRAIN_STYLES]
    else:
        clips = [("", content, style) for content in CONTENTS for style in STYLES[name]]
    items = []
    for kind, (creature, content, style) in enumerate(clips):
        take = 0
        for part, count in TAKES[name].items():
            for n in range(count):
                person = PERFORMERS[part][(kind * count + n) % len(PERFORMERS[part])]
                seed = _FIRST_SEED[name] + 32 * kind + take
                items.append(_item(creature, content, style, seed, person, take, part))
                take += 1
    return sorted(items, key=lambda item: item.name)


def _item(creature: str, content: str, style: str, seed: int, person: int, take: int, part: str) -> Item:
    name, kind = "_".join(filter(None, (creature, content, style, f"{take:02d}"))), creature or "person"
    texts = performed_captions(content, style, seed, subject=f"a {kind}")
    seconds = _seconds(creature, content, style, seed, person)
    source = ActorSource(content, style, seed, person, seconds, creature)
    return Item(name, Labels(content, style, texts, f"{kind} {person:02d}", name, part), source)


def _seconds(creature: str, content: str, style: str, seed: int, person: int) -> float:
    """By chance, but enough for one whole gesture of somebody slow; whole frames."""
    if creature:
        who = performing.get_creature(creature, person)
        deed, rate = who.species.actions.get(content), who.species.rate
        beats = deed.beats if deed else 0.0
    else:
        who, beats, rate = Performer.from_seed(person), GESTURES.get(content, 0.0), WALK_RATE
        rate *= (0.86 / who.leg) ** 0.5
    least = 1.05 * (beats + 0.75) / (rate * who.as_done_by(get_style(style)).tempo)
    chance = random.Random(f"{creature} {content} {style} {seed} seconds")
    return round(chance.uniform(min(max(SHORTEST, least), LONGEST), LONGEST) * FPS) / FPS


def fingerprint(positions: Tensor, first: int = 0) -> tuple[str, float]:
    """Tells whether two machines make the same clip: sha256 of where its joints are, in tenths of a millimetre.

    positions: [F, J, 3] metres, of `ActorSource.positions`. Every tenth frame counts, from `first` on. Also returns how
    far, in metres, the nearest number is from being rounded the other way: where that is far more than float64's last
    digits, another machine finds the same.

    >>> a, b = (ActorSource("walk", "old", seed, performer=7, seconds=4.0).positions() for seed in (3, 4))
    >>> fingerprint(a)[0] == fingerprint(a + 1e-12)[0], fingerprint(a)[0] == fingerprint(b)[0]
    (True, False)
    """
    tenths = positions[first::10] * 1e4
    whole = tenths.round()
    margin = float((0.5 - (tenths - whole).abs()).min()) * 1e-4
    return hashlib.sha256(whole.to(torch.int32).numpy().astype("<i4").tobytes()).hexdigest(), margin
