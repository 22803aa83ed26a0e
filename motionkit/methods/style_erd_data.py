"""Paper 2's training data: overlapping windows of labelled clips (section 4.1), and who is restyled into what.

The paper's pairs are any two clips of one content, a neutral and a styled one (section 3.2). Beyond the paper, a window
can be paired in time: a neutral clip brought by time warping to the time of a styled one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from ..datasets import Dataset
from ..errors import MotionKitError
from ..features.style_erd import frames_of, zero_first_velocity
from ..motion import Motion
from .base import NEUTRAL, without_helper_joints
from .neutral_pairs import NeutralPairs

WINDOW = 24  # frames (paper 2, section 4.1)
OVERLAP = 4  # frames of two windows (paper 2, section 4.1)


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows of a labelled dataset, of WINDOW frames each if nothing else is asked for.

    x: [N, F, 10J], each as the beginning of a stream, see `zero_first_velocity`. initial_velocity: [N, 3J], the
    velocities of the first frame, where it is none. window_index: long [N], how many windows of the same clip come
    before it. offsets: [N, J, 3] of each body; content, style: long [N], the neutral style 0. paired_with: long [N],
    the window that does the same in step, in a style or in none; -1: there is none. num_captured: how many, the first,
    are of clips as they are; the others are of neutral clips warped to the time of styled ones.
    """

    x: Tensor
    initial_velocity: Tensor
    window_index: Tensor
    offsets: Tensor
    content: Tensor
    style: Tensor
    contents: tuple[str, ...]
    styles: tuple[str, ...]
    paired_with: Tensor
    num_captured: int

    @classmethod
    def of(cls, data: Dataset, fps: float, frames: int = WINDOW, *, paired: bool = False) -> Windows:
        """All windows of all clips; MotionKitError where no style is neutral, or no clip is long enough.

        paired: and windows of the neutral clip that comes nearest to each styled one, in its time.
        """
        plain = [style for style in data.styles if style in NEUTRAL]
        if not plain:
            raise MotionKitError(f"Style-ERD needs a neutral style; dataset {data.name!r} has {', '.join(data.styles)}")
        styles = (*plain[:1], *(style for style in data.styles if style not in plain))
        rows: list[tuple] = []
        warped: list[tuple] = []  # with the number of the window that each is paired with
        pairs = NeutralPairs(data, smooth=True) if paired else None
        done_neutrally = {clip.content for clip in data if clip.style == styles[0]}
        for clip in data:
            body = without_helper_joints(clip.motion)
            content, style = data.contents.index(clip.content), styles.index(clip.style)
            if pairs and style and clip.content in done_neutrally:
                neutral = pairs.pair(body, clip.content, like=body).neutral
                warped += enumerate(_windows(neutral, fps, frames, content, 0), len(rows))
            rows += _windows(body, fps, frames, content, style)
        if not rows:
            raise MotionKitError(f"no clip of {data.name!r} has {frames} frames at {fps:g} a second")
        num_captured, paired_with = len(rows), torch.full((len(rows) + len(warped),), -1)
        for n, (number, row) in enumerate(warped, num_captured):
            paired_with[n], paired_with[number] = number, n
            rows.append(row)
        x, window_index, offsets, content, style = zip(*rows)
        x, offsets = torch.stack(x), torch.stack(offsets)
        window_index, content, style = map(torch.tensor, (window_index, content, style))
        joints = offsets.shape[1]
        initial_velocity = x[torch.arange(len(x)), (window_index == 0).long(), -3 * joints :]  # a clip's first: unknown
        labels = tuple(data.contents), styles, paired_with, num_captured
        return cls(zero_first_velocity(x, joints), initial_velocity, window_index, offsets, content, style, *labels)

    def mid_stream(self, rows: Tensor) -> Tensor:
        """Windows [..., F, 10J] as they are in the middle of a stream, by their numbers, long [...]."""
        x = self.x[rows].clone()
        x[..., 0, -self.initial_velocity.shape[1] :] = self.initial_velocity[rows]
        return x

    def burn_in(self, chosen: Tensor, back: int) -> Tensor:
        """The frames before windows, long [B], from the beginning of the `back`-th window before: [B, R, 10J]."""
        rows = chosen[:, None] - torch.arange(back, 0, -1)
        x = self.mid_stream(rows)[:, :, :-OVERLAP].flatten(1, 2)
        return zero_first_velocity(x, x.shape[2] // 10)

    @cached_property
    def members(self) -> dict[tuple[int, int], Tensor]:
        """The captured windows of every content and style."""
        members: dict[tuple[int, int], list[int]] = {}
        for n, kind in enumerate(zip(self.content[: self.num_captured].tolist(), self.style.tolist())):
            members.setdefault(kind, []).append(n)
        return {kind: torch.tensor(rows) for kind, rows in members.items()}

    @cached_property
    def by_style(self) -> dict[int, Tensor]:
        """The captured windows of every style."""
        style = self.style[: self.num_captured]
        return {s: torch.nonzero(style == s)[:, 0] for s in set(style.tolist())}


@dataclass(frozen=True, eq=False)
class Draw:
    """The batches of Style-ERD's training (paper 2, section 3.2): call it with a step.

    size: windows a batch. burn_in: half of the batches are not the beginning of a stream; the frames of up to so many
    earlier windows come before them (beyond the paper, where each window begins anew; 0). unpaired: a style need not
    have been seen doing the same, and the critic is shown whatever there is of it (paper 2, supplement C.1).
    """

    windows: Windows
    size: int
    burn_in: int = 0
    unpaired: bool = False

    def __call__(self, step: int) -> dict:
        """Frames `x` [B, F, 10J] of `content` and `style`, long [B]; the `target` style; `real` motion of the target.

        And `offsets` [B, J, 3]; `burn_in`, the frames before, or None; `pair`, the frames of the window that each is
        paired with in time, and `has_pair`, bool [B]; `real` [B, F, 6J] with its `real_content`.
        """
        windows, back = self.windows, self.back()
        chosen, target = self.choose(back)
        content, pair = windows.content[chosen], windows.paired_with[chosen]
        kinds = zip(content.tolist(), target.tolist())
        groups = [windows.by_style[s] if self.unpaired else windows.members[c, s] for c, s in kinds]
        real = torch.stack([rows[int(torch.rand(()) * len(rows))] for rows in groups])
        frames = windows.mid_stream if back else lambda rows: windows.x[rows]
        first = 4 * windows.offsets.shape[1]
        return {
            "x": frames(chosen),
            "content": content,
            "style": windows.style[chosen],
            "target": target,
            "offsets": windows.offsets[chosen][:, None],
            "burn_in": windows.burn_in(chosen, back) if back else None,
            "pair": frames(pair.clamp(min=0)),
            "has_pair": pair >= 0,
            "real": frames(real)[..., first:],
            "real_content": windows.content[real],
        }

    @cached_property
    def usable(self) -> Tensor:
        """Which windows have a target, bool [W]: a styled one needs its content done neutrally, or `unpaired`."""
        windows = self.windows
        if self.unpaired:
            return torch.ones(len(windows.x), dtype=torch.bool)
        kinds = zip(windows.content.tolist(), windows.style.tolist())
        able = torch.tensor([(content, 0) in windows.members for content, _ in kinds])
        if not able.any():
            raise MotionKitError(
                "Style-ERD learns from contents that are done neutrally and in a style; found none: take a config with "
                "cycle above 0, which needs no such pairs"
            )
        return able

    def back(self) -> int:
        """How many windows come before those of a batch: for half of the batches none; else up to `burn_in`."""
        most = 0 if self.unpaired else min(self.burn_in, int(self.windows.window_index.max()))
        return int(torch.randint(1, most + 1, ())) if most and torch.rand(()) < 0.5 else 0

    def choose(self, back: int = 0) -> tuple[Tensor, Tensor]:
        """Random windows, long [B], and the style that each is to be restyled in, long [B] (paper 2, section 3.2).

        Neutral ones go to any other style that has this content, styled ones to neutral, and those that are paired in
        time to the style of their pair. back: how many windows there must be before each.
        """
        windows = self.windows
        able = torch.nonzero(self.usable & (windows.window_index >= back))[:, 0]
        chosen = able[torch.randint(len(able), (self.size,))]
        target = []
        for content, style in zip(windows.content[chosen].tolist(), windows.style[chosen].tolist()):
            others = sorted({s for c, s in windows.members if s != 0 and (c == content or self.unpaired)})
            target.append(others[int(torch.rand(()) * len(others))] if style == 0 and others else 0)
        pair = windows.paired_with[chosen]
        return chosen, torch.where(pair < 0, torch.tensor(target), windows.style[pair])


def _windows(motion: Motion, fps: float, frames: int, content: int, style: int) -> list[tuple]:
    """A clip's windows: frames, how many come before, offsets of the body, labels."""
    x = frames_of(motion if abs(motion.fps - fps) < 1e-3 else motion.resample(fps, smooth=True)).x
    starts = range(0, len(x) - frames + 1, frames - OVERLAP)
    return [(x[n : n + frames], k, motion.translations[0], content, style) for k, n in enumerate(starts)]
