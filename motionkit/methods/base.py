"""What every method shares: `StyleTransfer`, the bracket around it, speed over the ground (paper 1, eq. 13), feet.

A method writes `transfer` and nothing else. `stylize` checks what comes in, brings it onto the model's skeleton and
frame rate, calls `transfer`, brings the result back onto the content's, plants the feet and names the result.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass
from typing import TypeVar
from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from .. import rotations as rot
from ..contacts import foot_contacts, lock_feet, two_bone_ik
from ..datasets import Clip, Labels
from ..dtw import gaussian_smooth
from ..errors import MotionKitError, motion_inside
from ..features.canonical import canonicalize
from ..motion import Motion
from ..retargeting import retarget
from ..skeleton import Skeleton

NEUTRAL = ("neutral", "normal")  # what data sets call the style of their neutral clips
STRONGEST = 5.0  # how many times all of a style somebody may ask for
_UNDER = 0.01  # metres: feet that go less deep under the ground are let go
_SOFT = 0.07  # seconds over which a foot that goes deeper is lifted
_T = TypeVar("_T")


@dataclass(frozen=True, eq=False)
class Example:
    """A style given by a clip, with what is known of that clip."""

    motion: Motion
    labels: Labels = Labels()

    @property
    def name(self) -> str:
        """The clip's name."""
        return self.motion.name


class StyleTransfer:
    """A method of style transfer. A subclass sets `name` and writes `transfer`; a row of the arena by itself.

    version: raised when its answers change, since kept results go by it. skeleton, fps: what its model was trained on;
    None where it works on any. plants_feet: whether planted feet may be held still at all.

    >>> class Slower(StyleTransfer):
    ...     name = "slower"
    ...     def transfer(self, body, style, strength, *, labels, seed):
    ...         return scale_path(body, 1 - 0.5 * strength)
    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> Slower().stylize(walk, style=walk)
    Motion('walk_neutral as walk_neutral', 120 frames at 30 fps, 4.0 s, 22 joints)
    """

    name: str = ""
    version: int = 1
    skeleton: Skeleton | None = None
    fps: float | None = None
    plants_feet: bool = True

    def stylize(
        self,
        content: Motion | Clip,
        style: object,
        strength: float = 1.0,
        *,
        lock_feet: bool = True,
        labels: Labels | None = None,
        seed: int = 0,
    ) -> Motion:
        """The content in a style.

        content: F frames of any length, frame rate and skeleton that can be brought to the model's; or a dataset's
        clip. style: as the method's class says: a label, a clip, a sentence, or a mapping of these to weights.
        strength: 0 is the content, 1 the style; more exaggerates. lock_feet: hold planted feet still. labels: what is
        known of the content; of a dataset's clip its own. seed: of all that is drawn. Returns F frames at the content's
        rate, on its skeleton. Raises MotionKitError that says what is wrong with the arguments, and for a body that
        cannot be brought to the model's.
        """
        if isinstance(content, Clip):
            labels, content = labels or content.labels, content.motion
        labels = labels or Labels()
        check_motion("content", content)
        check_strength(f"{self.name}: strength", strength)
        if not isinstance(labels, Labels):
            raise MotionKitError(f"{self.name}: labels are mk.methods.Labels('walk', 'neutral'); found {labels!r:.80}")
        name = f"{content.name} as {style_name(style)}"
        style = self.read_style(style)
        if strength == 0:
            return content.replace(name=name)
        body = self.onto_model(content)
        result = self.transfer(body, style, strength, labels=labels, seed=seed)
        return self.bring_back(result, content, name, lock_feet=lock_feet)

    def transfer(self, body: Motion, style: object, strength: float, *, labels: Labels, seed: int) -> Motion:
        """The paper: F frames of a body in a style, on the same skeleton and at the same rate.

        body: on `skeleton` and at `fps` where the method has them, without helper joints. style: as `read_style` gives
        it. strength: above 0, or below for the opposite. labels: of the content, where known.
        """
        raise NotImplementedError

    def read_style(self, style: object) -> object:
        """The style in the form that `transfer` takes; by default a clip as an `Example`. MotionKitError for others."""
        example = as_example(style)
        if example is None:
            raise MotionKitError(
                f"{self.name} takes its style from a motion: stylize(content, style=mk.load('style.bvh')); found "
                f"{style!r:.80}{motion_inside(style)}"
            )
        check_motion("style", example.motion)
        return example

    def onto_model(self, motion: Motion) -> Motion:
        """A motion on the model's skeleton and at its rate, without helper joints; MotionKitError where it cannot be.

        Bones stay as long as they are where the skeleton is the model's but for its size.
        """
        if not isinstance(motion, Motion):
            raise MotionKitError(f"{self.name} takes a Motion, such as mk.load('walk.bvh'); found {motion!r:.80}")
        body = without_helper_joints(motion)
        if self.skeleton is not None and not body.skeleton.same_tree(self.skeleton):
            joints, fps = len(self.skeleton), self.fps or body.fps
            rest = rot.identity_quaternion(1, joints)
            body = retarget_to(body, Motion.from_root(self.skeleton, rest, torch.zeros(1, 3), fps))
        if self.fps is not None and abs(body.fps - self.fps) > 1e-3:
            body = body.resample(self.fps, smooth=True)
        return body

    def bring_back(self, result: Motion, content: Motion, name: str, *, lock_feet: bool) -> Motion:
        """What the model made, on the content's skeleton, in its frames, with planted feet and a name."""
        body = without_helper_joints(content)
        if result.skeleton is not body.skeleton:
            result = retarget_to(result, body)
        if self.fps is not None and (len(result) != len(body) or abs(result.fps - body.fps) > 1e-3):
            times = torch.arange(len(body), dtype=torch.float64) * (self.fps / body.fps)
            result = result.sample(times, smooth=True).replace(fps=body.fps)
        result = self.place(result, body)
        if lock_feet and self.plants_feet:
            result = clean_up_feet(result, body)
        if len(result) != len(content):
            content = content.sample(torch.arange(len(result)))  # for the helper joints above the pelvis
        return content.with_helper_joints_of(result).replace(name=name)

    def place(self, result: Motion, content: Motion) -> Motion:
        """Where the result stands, beside the content: where `transfer` left it, unless a method says otherwise."""
        return result


def style_name(style: object) -> str:
    """What a style is called.

    >>> style_name("old"), style_name({"old": 0.5, "proud": 0.5})
    ('old', 'old + proud')
    """
    if isinstance(style, Mapping):
        return " + ".join(style_name(one) for one in style)
    return str(getattr(style, "name", style))


def as_example(style: object) -> Example | None:
    """A motion or a dataset's clip as an example of a style; None for anything else.

    >>> as_example("old") is None
    True
    """
    if isinstance(style, Clip):
        return Example(style.motion, style.labels)
    if isinstance(style, Motion):
        return Example(style)
    return style if isinstance(style, Example) else None


def check_motion(what: str, motion: object) -> None:
    """Raises MotionKitError unless it is a motion of two frames or more.

    >>> check_motion("content", "walk.bvh")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: the content must be a Motion, such as mk.load('walk.bvh'); found 'walk.bvh'
    """
    if not isinstance(motion, Motion):
        hint = motion_inside(motion)
        raise MotionKitError(f"the {what} must be a Motion, such as mk.load('walk.bvh'); found {motion!r:.80}{hint}")
    if len(motion) < 2:
        raise MotionKitError(f"the {what} clip {motion.name!r} has {len(motion)} frames; two are the least")


def check_strength(what: str, share: object) -> None:
    """Raises MotionKitError unless it is a number that can say how much of a style is wanted.

    >>> check_strength("strength", 1.5)
    >>> check_strength("strength", 50)
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: strength must be a number from -5 to 5, 1 for all of the style; found 50
    """
    if isinstance(share, bool) or not isinstance(share, int | float) or not abs(share) <= STRONGEST:
        bounds = f"from -{STRONGEST:g} to {STRONGEST:g}"
        raise MotionKitError(f"{what} must be a number {bounds}, 1 for all of the style; found {share!r}")


_BODIES: WeakKeyDictionary[Skeleton, Skeleton] = WeakKeyDictionary()


def without_helper_joints(motion: Motion) -> Motion:
    """`Motion.without_helper_joints`, with one skeleton object for all motions that share theirs: what it knows is
    worked out once.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> without_helper_joints(walk) is walk
    True
    """
    body = motion.without_helper_joints()
    return body if body is motion else body.replace(skeleton=_BODIES.setdefault(motion.skeleton, body.skeleton))


def same_rest(a: Skeleton, b: Skeleton) -> bool:
    """Whether two skeletons have one tree, and bones at rest that point the same ways: a pose means the same on both.

    Bone lengths may differ. What stands above the pelvis does not count.

    >>> from motionkit.skeleton import smpl
    >>> same_rest(smpl(), smpl(height=1.2, broad=0.1)), same_rest(smpl(), smpl().subtree([0, 1, 4]))
    (True, False)
    """
    if a is b or not a.same_tree(b):
        return a is b
    bones = a.descendants(a.pelvis)[1:]
    u, v = (rot.normalize(s.offsets[bones].double()) for s in (a, b))
    return not bones or float((u - v).norm(dim=-1).max()) < 0.15  # a broader body's bones lean a little more


def retarget_if_needed(motion: Motion, like: Motion) -> Motion:
    """A motion on a skeleton where poses mean what they mean for `like`: as it is if they do, else retargeted.

    Raises MotionKitError where the one body cannot do what the other does (`mk.retarget`).

    >>> import motionkit as mk
    >>> walk, old = (mk.load(f"data/actor/walk_{s}.bvh") for s in ("neutral", "old"))
    >>> retarget_if_needed(old, walk) is old
    True
    """
    return motion if same_rest(motion.skeleton, like.skeleton) else retarget(motion, like)


def retarget_to(motion: Motion, like: Motion) -> Motion:
    """A motion on the very skeleton of another: as it is if it stands on it, else retargeted, bone lengths and all.

    >>> import motionkit as mk
    >>> walk, old = (mk.load(f"data/actor/walk_{s}.bvh") for s in ("neutral", "old"))
    >>> retarget_to(old, walk).skeleton is walk.skeleton
    True
    """
    a, b = motion.skeleton, like.skeleton
    if a is b or (a.same_tree(b) and float((a.offsets - b.offsets).abs().max()) < 1e-5):
        return motion.replace(skeleton=b)
    try:
        return retarget(motion, like)
    except MotionKitError:
        if not same_rest(a, b):
            raise
    scale = b.height / max(a.height, 1e-6)  # a creature's joints are not those of a person, but these two share theirs
    return Motion.from_root(b, motion.rotations, motion.translations[:, 0] * scale, motion.fps, name=motion.name)


def velocity_factor(motion: Motion) -> float:
    """How lively a clip is (paper 1, eq. 13): the fastest joint's speed relative to the root, averaged over time, m/s.

    >>> import motionkit as mk
    >>> velocity_factor(mk.load("data/actor/walk_old.bvh")) < velocity_factor(mk.load("data/actor/walk_neutral.bvh"))
    True
    """
    seen = canonicalize(motion).local
    local = seen - seen[:, motion.skeleton.pelvis, None]
    if len(local) < 2:
        return 0.0
    speed = torch.linalg.vector_norm(local[1:] - local[:-1], dim=-1) * motion.fps
    return float(speed.amax(1).mean())


def liveliness(motion: Motion) -> float:
    """`velocity_factor` per metre of the character's height, so that tall and short ones compare; above 0.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> liveliness(walk) * walk.skeleton.height == velocity_factor(walk)
    True
    """
    return max(velocity_factor(motion) / max(motion.skeleton.height, 1e-6), 1e-6)


def warp_velocity(features: Tensor, factor: float) -> Tensor:
    """Scale the root's speed over the ground in `FacingFree` features [F, D] by U_style / U_content (paper 1, eq. 13).

    >>> warp_velocity(torch.tensor([[0.1, 0.02, 0.04, 0.9]]), 0.5)
    tensor([[0.1000, 0.0100, 0.0200, 0.9000]])
    """
    features = features.clone()
    features[:, 1:3] *= factor
    return features


def scale_path(motion: Motion, factor: float) -> Motion:
    """A motion without helper joints that goes `factor` times as far over the ground, from where it starts.

    It is `warp_velocity` without the way through features.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> scale_path(walk, 0.5).root_path()[-1] - walk.root_path().lerp(walk.root_path()[:1], 0.5)[-1]
    tensor([0., 0.])
    """
    translations = motion.translations.clone()
    path = translations[:, 0, [0, 2]]
    translations[:, 0, [0, 2]] = path[:1] + factor * (path - path[:1])
    return motion.replace(translations=translations)


def match_root_speed(body: Motion, content: Motion) -> Motion:
    """A restyled body whose speed over the ground goes with its own movements (paper 1, eq. 13, see `velocity_factor`).

    The paper's factor is that of the style clip over the content's. It speaks of what is done in the style clip: one
    who waits angrily would make a walk stop. Here it is that of the content's own poses after and before restyling.
    body, content: F frames each on one skeleton, without helper joints.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> bool((match_root_speed(walk, walk).positions() - walk.positions()).abs().max() < 1e-5)
    True
    """
    return scale_path(body, speed_ratio(body, content))


def speed_ratio(body: Motion, content: Motion) -> float:
    """The factor of `match_root_speed`, within bounds.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> speed_ratio(walk, walk)
    1.0
    """
    return clamp_ratio(velocity_factor(body) / max(velocity_factor(content), 1e-6))


def clamp_ratio(factor: float, most: float = 3.0) -> float:
    """A factor of speed, no more than `most` and no less than its inverse: a body that waits hardly moves at all.

    >>> clamp_ratio(0.6), clamp_ratio(80.0)
    (0.6, 3.0)
    """
    return min(max(factor, 1 / most), most)


def align_start(body: Motion, content: Motion) -> Motion:
    """A motion turned and moved so that it starts where another one starts, facing the same way.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> gap = align_start(walk.transform(1.0, (2.0, 0.0, 3.0)), walk).positions() - walk.positions()
    >>> bool(gap.abs().max() < 1e-4)
    True
    """
    start, there = content[:1], body[:1]
    turned = body.transform(start.facing()[0] - there.facing()[0])
    shift = start.root_path()[0] - turned[:1].root_path()[0]
    return turned.transform(offset=(float(shift[0]), 0.0, float(shift[1])))


def clean_up_feet(body: Motion, content: Motion) -> Motion:
    """Standing feet held still, at the height that the content's have, when those stand; no foot under the ground.

    body, content: F frames each on one skeleton. A body without feet is returned as it is.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> float(clean_up_feet(walk.transform(offset=(0, 0.1, 0)), walk).positions()[..., 1].min()) < 0.02
    True
    """
    try:
        feet = list(body.skeleton.feet())
    except MotionKitError:
        return body
    stands = foot_contacts(content)
    tips = [n for n, j in enumerate(feet) if not set(body.skeleton.descendants(j)[1:]) & set(feet)]  # toes, not ankles
    higher = (content.positions() - body.positions())[:, [feet[n] for n in tips], 1]
    translations = body.translations.clone()
    translations[:, 0, 1] += (higher[stands[:, tips]] if stands[:, tips].any() else higher).median()
    return _above_ground(lock_feet(body.replace(translations=translations), stands), content, feet)


def _above_ground(body: Motion, content: Motion, feet: list[int]) -> Motion:
    """Legs bent where a foot joint would be deeper than it ever is in the content: in swing, nobody has held it."""
    floor = content.positions()[:, feet, 1].amin(0)
    for side in ("left", "right"):
        leg = tuple(body.skeleton.roles.get(f"{side}_{r}", -1) for r in ("hip", "knee", "ankle"))
        if min(leg) < 0 or [body.skeleton.parents[j] for j in leg[1:]] != list(leg[:2]):
            continue
        mine = [n for n, j in enumerate(feet) if leg[2] in body.skeleton.ancestors(j)]
        places = body.positions()
        under = (floor[mine] - places[:, [feet[n] for n in mine], 1]).amax(1).clamp(min=0)
        if under.max() > _UNDER:
            around = max(1, round(_SOFT * body.fps))
            most = torch.nn.functional.max_pool1d(under[None, None], 2 * around + 1, 1, around)[0, 0]
            up = torch.stack(
                (torch.zeros_like(most), gaussian_smooth(most[:, None], around)[:, 0], torch.zeros_like(most)), -1
            )
            body = two_bone_ik(body, leg, places[:, leg[2]] + up)
    return body


def motion_hash(motion: Motion) -> bytes:
    """The same for motions that are the same to the last bit, and for no others: what caches go by.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> motion_hash(walk[:]) == motion_hash(walk), motion_hash(walk) == motion_hash(walk[1:])
    (True, False)
    """
    found = hashlib.blake2b(f"{motion.fps} {motion.skeleton.names} {motion.skeleton.parents}".encode(), digest_size=16)
    for numbers in (motion.rotations, motion.translations, motion.skeleton.offsets):
        found.update(numbers.detach().cpu().contiguous().numpy())
    return found.digest()


def rest_key(skeleton: Skeleton) -> tuple:
    """The same for skeletons of one tree with the same bones at rest, to a tenth of a millimetre.

    >>> from motionkit.skeleton import smpl
    >>> rest_key(smpl()) == rest_key(smpl()), rest_key(smpl()) == rest_key(smpl(height=1.6))
    (True, False)
    """
    bones = (skeleton.offsets.double() * 1e4).round().long().flatten().tolist()
    return skeleton.names, skeleton.parents, tuple(bones)


class LRUCache:
    """Keeps what was worked out, the `most` latest of it.

    >>> memory = LRUCache(most=2)
    >>> [memory.get(n, lambda: print("worked out") or n) for n in (1, 1)]
    worked out
    [1, 1]
    """

    def __init__(self, most: int = 512) -> None:
        self.most, self._kept = most, OrderedDict()

    def get(self, key: Hashable, make: Callable[[], _T]) -> _T:
        """What is kept under the key, or else what `make` gives, which is then kept."""
        if key not in self._kept:
            self._kept[key] = make()
            while len(self._kept) > self.most:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return self._kept[key]
