"""Restyling without training: give the content clip the mean and spread of the style clip.

That is the idea under every method that uses adaptive instance normalisation (AdaIN): style is what remains of a clip
when its order in time is forgotten. Here it works on the poses themselves instead of on a network's features.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..contacts import foot_contacts, lock_feet
from ..errors import MotionKitError, motion_inside
from ..features import FacingFree
from ..features.bones import bone_directions, bone_names, turn_bones
from ..motion import Motion
from ..rotations import normalize


def match_statistics(content: Tensor, style: Tensor, most: float = 3.0) -> Tensor:
    """Content features [F, D] shifted and scaled to the mean and spread of style features [G, D], number by number.

    most: no spread grows more than so many times, since numbers that hardly move in the content only hold noise.
    This is AdaIN (Huang and Belongie 2017, eq. 8) on poses instead of network features.

    >>> match_statistics(torch.tensor([[0.0], [2.0]]), torch.tensor([[4.0], [8.0]]))
    tensor([[4.],
            [8.]])
    """
    spread, wanted = content.std(0, correction=0), style.std(0, correction=0)
    gain = (wanted / spread.clamp(min=1e-6)).clamp(max=most)
    return (content - content.mean(0)) * gain + style.mean(0)


def velocity_factor(motion: Motion) -> float:
    """How lively a clip is (paper 1, eq. 13): the fastest joint's speed relative to the root, averaged over time, m/s.

    >>> import motionkit as mk
    >>> velocity_factor(mk.load("data/actor/walk_old.bvh")) < velocity_factor(mk.load("data/actor/walk_neutral.bvh"))
    True
    """
    layout = FacingFree()
    local = layout.encode(motion)[:, layout.slices["positions"]].unflatten(1, (-1, 3))
    if len(local) < 2:
        return 0.0
    speed = torch.linalg.vector_norm(local[1:] - local[:-1], dim=-1) * motion.fps
    return float(speed.amax(1).mean())


def warp_velocity(features: Tensor, factor: float) -> Tensor:
    """Scale the root's speed over the ground in `FacingFree` features [F, D] by U_style / U_content (paper 1, eq. 13).

    >>> warp_velocity(torch.tensor([[0.1, 0.02, 0.04, 0.9]]), 0.5)
    tensor([[0.1000, 0.0100, 0.0200, 0.9000]])
    """
    features = features.clone()
    features[:, 1:3] *= factor
    return features


class Statistics:
    """Statistics transfer: match mean and spread per feature, warp the speed (paper 1, eq. 13), lock the feet.

    It needs no training and one style clip. On one skeleton the features are paper 1's (`FacingFree`); between rigs
    with other joints or rest poses they are the directions of the bones that both have by name. It carries postures
    well; timing, and whatever the style does in another order than the content, it cannot.

    >>> import motionkit as mk
    >>> walk, style = mk.load("data/actor/walk_neutral.bvh"), mk.load("data/actor/walk_old.bvh")
    >>> old = mk.methods.load("statistics").stylize(walk, style=style)
    >>> len(old), old.name
    (120, 'walk_neutral as walk_old')
    """

    name = "statistics"

    def stylize(self, content: Motion, style: Motion, strength: float = 1.0, lock: bool = True) -> Motion:
        """The content clip in the manner of the style clip.

        content: F frames. style: a Motion of any length and frame rate. strength: 0 keeps the content, 1 takes all of
        the style's statistics, more exaggerates. lock: hold standing feet still. Returns F frames at the content's
        rate, on its skeleton, starting where it starts. Raises MotionKitError if the style is no Motion, a clip is too
        short, or the skeletons have too few bones in common.
        """
        self._check(content, style)
        given, wanted = content.body(), style.resample(content.fps).body()
        factor = 1 + strength * (_relative_liveliness(wanted) / max(_relative_liveliness(given), 1e-6) - 1)
        if given.skeleton.same_tree(wanted.skeleton):
            body = self._by_features(given, wanted, factor, strength)
        else:
            body = self._by_directions(given, wanted, factor, strength)
        start = given[:1]
        place = start.root_path()[0]
        body = body.moved(start.facing()[0], (float(place[0]), 0.0, float(place[1])))
        if lock:
            body = self._on_the_ground(body, given, wanted)
        return content.with_body(body).replace(name=f"{content.name} as {style.name}")

    def _check(self, content: Motion, style: Motion) -> None:
        if not isinstance(content, Motion):
            hint = motion_inside(content)
            raise MotionKitError(f"the content must be a Motion, such as mk.load('walk.bvh'); found {content!r}{hint}")
        if not isinstance(style, Motion):
            raise MotionKitError(
                f"statistics transfer takes its style from a motion: stylize(content, style=mk.load('style.bvh')); "
                f"found {style!r}{motion_inside(style)}. Labels and sentences need a trained method"
            )
        for what, motion in (("content", content), ("style", style)):
            if len(motion) < 2:
                raise MotionKitError(f"the {what} clip {motion.name!r} has {len(motion)} frames; two are the least")

    def _by_features(self, content: Motion, style: Motion, factor: float, strength: float) -> Motion:
        """Both on one skeleton: match everything but the root's path, whose speed is warped."""
        layout = FacingFree(content.skeleton, content.fps)
        x = layout.encode(content)
        y = torch.lerp(x, match_statistics(x, FacingFree(style.skeleton, content.fps).encode(style)), strength)
        y[:, :3] = x[:, :3]
        return layout.decode(warp_velocity(y, factor))

    def _by_directions(self, content: Motion, style: Motion, factor: float, strength: float) -> Motion:
        """Two rigs: match the directions of the bones that both have; the pelvis sinks as far as the style's does."""
        shared = [b for b in bone_names(content.skeleton) if b in bone_names(style.skeleton)]
        if len(shared) < 3:
            raise MotionKitError(
                f"content {content.skeleton!r} and style {style.skeleton!r} have too few bones in common by name "
                f"({', '.join(shared) or 'none'}): take a style clip of the same character, or name the joints alike"
            )
        now, target = bone_directions(content, shared).flatten(1), bone_directions(style, shared).flatten(1)
        mixed = torch.lerp(now, match_statistics(now, target), strength)
        turned = turn_bones(content, shared, normalize(mixed.unflatten(1, (-1, 3))))
        sink = _relative_height(style) / _relative_height(content)
        layout = FacingFree(content.skeleton, content.fps)
        x = warp_velocity(layout.encode(turned), factor)
        path = layout.encode(content)
        x[:, :3] = warp_velocity(path, factor)[:, :3]
        x[:, 3] = path[:, 3] * (1 + strength * (sink - 1))
        return layout.decode(x)

    def _on_the_ground(self, body: Motion, content: Motion, style: Motion) -> Motion:
        """Put standing feet at the height that the content's have, then hold them still while those stand."""
        try:
            feet = list(body.skeleton.feet())
        except MotionKitError:
            return body  # a body without feet keeps its height
        stands = foot_contacts(content)
        tips = [n for n, j in enumerate(feet) if not set(body.skeleton.below(j)[1:]) & set(feet)]  # toes, not ankles
        higher = (content.positions() - body.positions())[:, [feet[n] for n in tips], 1]
        translations = body.translations.clone()
        translations[:, 0, 1] += (higher[stands[:, tips]] if stands[:, tips].any() else higher).median()
        return lock_feet(body.replace(translations=translations), stands)


def _relative_liveliness(motion: Motion) -> float:
    """`velocity_factor` per metre of height, so that tall and short characters compare."""
    return velocity_factor(motion) / max(motion.skeleton.height, 1e-6)


def _relative_height(motion: Motion) -> float:
    """The pelvis' mean height above the lowest joint of the clip, per metre of the character's height."""
    places = motion.positions()
    floor = places[..., 1].quantile(0.02) if places[..., 1].numel() < 1e7 else places[..., 1].min()
    return max(float(places[:, motion.skeleton.pelvis, 1].mean() - floor), 1e-3) / max(motion.skeleton.height, 1e-6)
