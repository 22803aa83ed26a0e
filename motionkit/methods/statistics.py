"""Restyling without training: give the content clip the mean and spread of the style clip.

That is the idea under every method that uses adaptive instance normalisation (AdaIN): style is what remains of a clip
when its order in time is forgotten. Here it works on the poses themselves instead of on a network's features.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..features import FacingFree
from ..motion import Motion
from ..restyling import (
    Memory,
    body_of,
    check_clips,
    fitting,
    key_of,
    liveliness,
    named,
    on_the_ground,
    rest_key,
    velocity_factor,
    warp_velocity,
    within,
)

__all__ = ["Statistics", "match_statistics", "velocity_factor", "warp_velocity"]


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


class Statistics:
    """Statistics transfer: match mean and spread per feature, warp the speed (paper 1, eq. 13), lock the feet.

    It needs no training and one style clip. The features are paper 1's (`FacingFree`); a style on another rig is
    retargeted to the content's first. It carries postures well; timing, and whatever the style does in another order
    than the content, it cannot.

    >>> import motionkit as mk
    >>> walk, style = mk.load("data/actor/walk_neutral.bvh"), mk.load("data/actor/walk_old.bvh")
    >>> old = mk.methods.load("statistics").stylize(walk, style=style)
    >>> len(old), old.name
    (120, 'walk_neutral as walk_old')
    """

    name = "statistics"

    def __init__(self) -> None:
        self._fitted = Memory(32)

    def stylize(self, content: Motion, style: Motion, strength: float = 1.0, lock: bool = True) -> Motion:
        """The content clip in the manner of the style clip.

        content: F frames. style: a Motion of any length, frame rate and skeleton that can be retargeted to the
        content's. strength: 0 keeps the content, 1 takes all of the style's statistics, more exaggerates. lock: hold
        standing feet still. Returns F frames at the content's rate, on its skeleton, starting where it starts. Raises
        MotionKitError if the style is no Motion, a clip is too short, strength is no number, or the style's body cannot
        be brought to the content's.
        """
        check_clips(self.name, content, style, strength)
        if strength == 0:
            return content.replace(name=named(content, style))
        given, layout = body_of(content), FacingFree(fps=content.fps)
        x = layout.encode(given)
        wanted, style_liveliness = self._style(style, given)
        y = torch.lerp(x, match_statistics(x, wanted), strength)
        y[:, :3] = x[:, :3]  # the path is the content's; only its speed is warped
        factor = 1 + strength * (within(style_liveliness / liveliness(given)) - 1)
        place = given.translations[0, 0] * torch.tensor([1.0, 0.0, 1.0])
        body = layout.decode(warp_velocity(y, factor)).moved(given[:1].facing()[0], place)
        if lock:
            body = on_the_ground(body, given)
        return content.with_body(body).replace(name=named(content, style))

    def _style(self, style: Motion, content: Motion) -> tuple[Tensor, float]:
        """The style's features [G, D] on the content's kind of body, and how lively it is."""

        def work_out() -> tuple[Tensor, float]:
            fitted = fitting(body_of(style.resample(content.fps)), content)
            return FacingFree(fitted.skeleton, content.fps).encode(fitted), liveliness(fitted)

        return self._fitted.get((key_of(style), content.fps, rest_key(content.skeleton)), work_out)
