"""Restyling without training: give the content clip the mean and spread of the style clip.

That is the idea under every method that uses adaptive instance normalisation (AdaIN): style is what remains of a clip
when its order in time is forgotten. Here it works on the poses themselves instead of on a network's features.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..contacts import foot_contacts, lock_feet
from ..errors import MotionKitError
from ..features import FacingFree
from ..motion import Motion


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
    >>> velocity_factor(mk.load("data/walk_old.bvh")) < velocity_factor(mk.load("data/walk_neutral.bvh"))
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

    It needs no training and one style clip on the same skeleton. It carries postures well; timing, and whatever
    the style does in another order than the content, it cannot.

    >>> import motionkit as mk
    >>> old = mk.methods.load("statistics").stylize(mk.load("data/walk_neutral.bvh"), style=mk.load("data/walk_old.bvh"))
    >>> len(old), old.name
    (120, 'walk_neutral as walk_old')
    """

    name = "statistics"

    def stylize(self, content: Motion, style: Motion, strength: float = 1.0, lock: bool = True) -> Motion:
        """The content clip in the manner of the style clip.

        content: F frames. style: a Motion on the same skeleton, of any length and frame rate. strength: 0 keeps the
        content, 1 takes all of the style's statistics, more exaggerates. lock: hold standing feet still. Returns F
        frames at the content's rate, starting where the content starts. Raises MotionKitError if the style is no
        Motion or the skeletons differ.
        """
        content_body, style_body = self._bodies(content, style)
        layout = FacingFree(content_body.skeleton, content.fps)
        x = layout.encode(content_body)
        wanted = FacingFree(style_body.skeleton, content.fps).encode(style_body)
        factor = velocity_factor(style_body) / max(velocity_factor(content_body), 1e-6)
        y = warp_velocity(match_statistics(x, wanted), factor)
        y[:, :3] = torch.where(torch.tensor([True, False, False]), x[:, :3], warp_velocity(x, factor)[:, :3])
        body = layout.decode(torch.lerp(x, y, strength))
        start = content_body[:1]
        yaw, place = start.facing()[0], start.root_path()[0]
        body = body.moved(yaw, (float(place[0]), 0.0, float(place[1])))
        if lock:
            body = self._on_the_ground(body, content_body, style_body)
        return content.with_body(body).replace(name=f"{content.name} as {style.name}")

    def _bodies(self, content: Motion, style: Motion) -> tuple[Motion, Motion]:
        """Both clips without helper joints above the pelvis, at the content's frame rate; checked."""
        if not isinstance(style, Motion):
            raise MotionKitError(
                f"statistics transfer takes its style from a motion: stylize(content, style=mk.load('style.bvh')); "
                f"found {style!r}. Labels and sentences need a trained method"
            )
        for what, motion in (("content", content), ("style", style)):
            if len(motion) < 2:
                raise MotionKitError(f"the {what} clip {motion.name!r} has {len(motion)} frames; two are the least")
        if not content.skeleton.same_tree(style.skeleton):
            extra = sorted(set(content.skeleton.names) ^ set(style.skeleton.names))[:4]
            raise MotionKitError(
                f"content {content.skeleton!r} and style {style.skeleton!r} differ"
                + (f" (for example in {', '.join(map(repr, extra))})" if extra else " in the order of their joints")
                + ": statistics transfer needs both on one skeleton"
            )
        return content.body(), style.resample(content.fps).body()

    def _on_the_ground(self, body: Motion, content: Motion, style: Motion) -> Motion:
        """Put the lowest foot where the style has it, then hold feet still while the content's feet stand."""
        try:
            feet = list(body.skeleton.feet())
        except MotionKitError:
            return body  # a body without feet keeps its height
        lift = style.positions()[:, feet, 1].quantile(0.02) - body.positions()[:, feet, 1].quantile(0.02)
        translations = body.translations.clone()
        translations[:, 0, 1] += lift
        return lock_feet(body.replace(translations=translations), foot_contacts(content))
