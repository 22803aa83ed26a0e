"""KNN + DTW: the difference between a styled clip and its nearest neutral clip, carried over to another motion.

The way before networks, and the one that paper 1 compares its own neutral motions with (section 6.2, tables 2 and 3).
The paper says how the pair is found; how its difference is carried over is this kit's choice, in the manner of Xia et
al. 2015: by the poses in which it was seen.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..alignment import movement, smoothed
from ..datasets import Dataset
from ..motion import Motion
from ..pairs import NEUTRAL, ByLabels, NeutralPairs, add_difference
from ..restyling import body_of, check_clips, in_step, named, on_the_ground

_NEAR = 0.3  # frames less unlike than this, in the unit of `movement`, count as the same
_EASE = 0.07  # seconds: standard deviation of the Gaussian over differences that are carried over


class KnnDtw(ByLabels):
    """KNN + DTW style transfer (paper 1, section 6.2, tables 2 and 3): pairs from a library, no training.

    The style clip's pair is the nearest segment of a neutral clip of the same content, aligned by dynamic time warping.
    In each frame of the content, the result is the content plus the pair's difference in those frames whose neutral
    pose and speed are most like the content's; so a kick can be as old as the walk it is taken from. A content that is
    styled itself is made neutral in the same way first. The content's timing stays; the root's speed goes with the
    size of the movements (`restyling.in_step`, after paper 1, eq. 13). library: a labelled Dataset; left out, `actor`'s
    training part.

    >>> import motionkit as mk
    >>> from motionkit.datasets import BvhSource, Item, Labels, of_items
    >>> walk, style = mk.load("data/actor/walk_neutral.bvh"), mk.load("data/actor/walk_old.bvh")
    >>> jump = Item("jump", Labels("jump", "neutral", ()), BvhSource.at("data/actor/jump_neutral.bvh"))
    >>> step = Item("walk", Labels("walk", "neutral", ()), BvhSource.at("data/actor/walk_neutral.bvh"))
    >>> method = mk.methods.load("knn-dtw", library=of_items("mine", [jump, step]))
    >>> method.stylize(walk, style=style, style_content="walk")
    Motion('walk_neutral as walk_old', 120 frames at 30 fps, 4.0 s, 22 joints)
    """

    name = "knn-dtw"

    def __init__(self, library: Dataset | None = None) -> None:
        self.pairs = NeutralPairs(library)

    def fit(self, train: Dataset) -> KnnDtw:
        """Take pairs from this dataset from now on; its clips are read when they are first needed."""
        self.pairs = NeutralPairs(train)
        return self

    def neutral_pair(self, style: Motion, content: str | None = None) -> Motion:
        """The neutral motion that goes with a styled one, frame by frame, on its skeleton (paper 1, table 2).

        content: what the clip does, a label of the library; left out, neutral clips of all contents are searched.
        """
        check_clips(self.name, style, style)
        return self.pairs.neutral_of(style, content)

    def stylize(
        self,
        content: Motion,
        style: Motion,
        strength: float = 1.0,
        lock: bool = True,
        *,
        content_label: str | None = None,
        content_style: str | None = None,
        style_content: str | None = None,
        style_label: str | None = None,
    ) -> Motion:
        """The content clip in the manner of the style clip.

        content: F frames. style: a Motion of any length, frame rate and skeleton that can be retargeted to the
        content's. strength: 0 keeps the content, 1 is the style, more exaggerates. lock: hold standing feet still.
        content_label, style_content: what is done in each clip, labels of the library; left out, the nearest clip over
        all contents is taken. content_style: the content's own style; left out, it counts as neutral. style_label: the
        style's; where it is neutral, the content is only made neutral. Returns F frames at the content's rate, on its
        skeleton, starting where it starts. Raises MotionKitError for arguments that are none of these.
        """
        check_clips(self.name, content, style, strength)
        if strength == 0:
            return content.replace(name=named(content, style))
        given = body_of(content)
        body = given
        if content_style is not None and content_style not in NEUTRAL:
            own = self.pairs.pair(content, content_label, given)
            body = add_difference(body, -strength * carried(body, own.looks[0], own.difference))
        if style_label not in NEUTRAL:
            pair = self.pairs.pair(style.resample(content.fps), style_content, given)
            body = add_difference(body, strength * carried(body, pair.looks[1], pair.difference))
        body = in_step(body, given)
        if lock:
            body = on_the_ground(body, given)
        return content.with_body(body).replace(name=named(content, style))


def carried(motion: Motion, known: Tensor, differences: Tensor) -> Tensor:
    """For each frame of a motion the differences of those of another's frames that are most like it, [F, D].

    known: `movement` of the other, [G, 6J], not centred. differences: [G, D], one for each of its frames. Frames count
    by a Gaussian of how unlike they are, which is as wide as the nearest one is far: where nothing is near, it becomes
    their mean. Eased over neighbouring frames.

    >>> import motionkit as mk
    >>> walk = mk.load("data/actor/walk_neutral.bvh")
    >>> carried(walk[:50], movement(walk, centred=False), torch.ones(120, 1)).mean()
    tensor(1.)
    """
    unlike = torch.cdist(movement(motion, centred=False), known)
    width = unlike.amin(1, keepdim=True).clamp(min=_NEAR)
    weights = torch.softmax(-0.5 * (unlike / width) ** 2, 1)
    return smoothed(weights @ differences, _EASE * motion.fps)
