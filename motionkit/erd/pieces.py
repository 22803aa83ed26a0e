"""What Style-ERD learns from: windows of clips (paper 2, section 4.1), and neutral ones in step with styled ones."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ..datasets import Clip, Dataset
from ..errors import MotionKitError
from ..layers.critics import WINDOW
from ..motion import Motion
from ..pairs import NEUTRAL, NeutralPairs
from ..restyling import body_of
from .frames import begun, frames_of

OVERLAP = 4  # frames of two windows (paper 2, section 4.1)


@dataclass(frozen=True, eq=False)
class Pieces:
    """Windows of a labelled dataset, of WINDOW frames each if nothing else is asked for.

    x: [N, F, 10J], each as the beginning of a stream, see `frames.begun`. going: [N, 3J], the velocities of the first
    frame, where it is none. earlier: long [N], how many windows of the same clip come before it. offsets: [N, J, 3] of
    each body; content, style: long [N], the neutral style 0. twin: long [N], the window that does the same in step, in
    a style or in none; -1: there is none. recorded: how many, the first, are of clips as they are; the others are of
    neutral clips warped to the time of styled ones.
    """

    x: Tensor
    going: Tensor
    earlier: Tensor
    offsets: Tensor
    content: Tensor
    style: Tensor
    contents: tuple[str, ...]
    styles: tuple[str, ...]
    twin: Tensor
    recorded: int

    @classmethod
    def of(cls, data: Dataset, fps: float, frames: int = WINDOW, registered: bool = False) -> Pieces:
        """All windows of all clips; MotionKitError where no style is neutral, or no clip is long enough.

        registered: and windows of the neutral clip that comes nearest to each styled one, in its time.
        """
        plain = [style for style in data.styles if style in NEUTRAL]
        if not plain:
            raise MotionKitError(f"Style-ERD needs a neutral style; dataset {data.name!r} has {', '.join(data.styles)}")
        styles = (*plain[:1], *(style for style in data.styles if style not in plain))
        rows: list[tuple] = []
        warped: list[tuple] = []
        pairs = _Partners(data) if registered else None
        for clip in data:
            labels = data.contents.index(clip.content), styles.index(clip.style)
            found = _windows(body_of(clip.motion), fps, frames, *labels)
            partner = pairs.of(clip) if pairs and labels[1] else None
            if partner is not None:
                twins = _windows(partner, fps, frames, labels[0], 0)
                warped += [(len(rows) + k, row) for k, row in enumerate(twins)]
            rows += found
        if not rows:
            raise MotionKitError(f"no clip of {data.name!r} has {frames} frames at {fps:g} a second")
        recorded, twin = len(rows), torch.full((len(rows) + len(warped),), -1)
        for n, (number, row) in enumerate(warped, recorded):
            twin[n], twin[number] = number, n
            rows.append(row)
        x, earlier, offsets, content, style = zip(*rows)
        x, joints = torch.stack(x), len(offsets[0])
        earlier, content, style = map(torch.tensor, (earlier, content, style))
        going = x[torch.arange(len(x)), (earlier == 0).long(), -3 * joints :]  # a clip's first frame knows none
        known = tuple(data.contents), styles, twin, recorded
        return cls(begun(x, joints), going, earlier, torch.stack(offsets), content, style, *known)

    def amid(self, rows: Tensor) -> Tensor:
        """Windows [..., F, 10J] as they are in the middle of a stream, by their numbers, long [...]."""
        x = self.x[rows].clone()
        x[..., 0, -self.going.shape[1] :] = self.going[rows]
        return x

    def run_up(self, chosen: Tensor, back: int) -> Tensor:
        """The frames before windows, long [B], from the beginning of the `back`-th window before: [B, R, 10J]."""
        rows = chosen[:, None] - torch.arange(back, 0, -1)
        x = self.amid(rows)[:, :, :-OVERLAP].flatten(1, 2)
        return begun(x, x.shape[2] // 10)

    def members(self) -> dict[tuple[int, int], Tensor]:
        """The recorded windows of every content and style."""
        found: dict[tuple[int, int], list[int]] = {}
        for n, kind in enumerate(zip(self.content[: self.recorded].tolist(), self.style.tolist())):
            found.setdefault(kind, []).append(n)
        return {kind: torch.tensor(own) for kind, own in found.items()}


class _Partners:
    """For styled clips of a dataset its neutral clips, each the nearest of its content, in the styled clip's time."""

    def __init__(self, data: Dataset) -> None:
        self.pairs = NeutralPairs(data, smooth=True)
        self.able = {clip.content for clip in data.filter(style=next(s for s in data.styles if s in NEUTRAL))}

    def of(self, clip: Clip) -> Motion | None:
        """The neutral motion; None where nobody does this neutrally."""
        body = body_of(clip.motion)
        return self.pairs.pair(body, clip.content, like=body).neutral if clip.content in self.able else None


def _windows(motion: Motion, fps: float, frames: int, content: int, style: int) -> list[tuple]:
    """A clip's windows: frames, how many come before, offsets of the body, labels."""
    x = frames_of(motion if abs(motion.fps - fps) < 1e-3 else motion.resample(fps, smooth=True)).x
    starts = range(0, len(x) - frames + 1, frames - OVERLAP)
    return [(x[n : n + frames], k, motion.translations[0], content, style) for k, n in enumerate(starts)]
