"""Retrieval: how often the right sentence is found for a motion, among 32."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import torch
from torch import Tensor

from ..errors import MotionKitError
from ..text import similarity

AMONG = 32


def recalls(
    motions: Tensor, texts: Tensor, groups: Sequence[Hashable], among: int = AMONG, rounds: int = 100, seed: int = 0
) -> dict[str, float]:
    """R@1 and R@3 in per cent: in how many cases the own sentence is the nearest, or one of the three nearest.

    motions, texts: [N, E], pairs. groups: what each pair means, such as (content, style): in each round `among` pairs
    of different groups are drawn, so that no wrong sentence would be right too. Among sentences that are equally near
    each is as likely to be taken, so a network that says the same of all finds one in 32. Raises MotionKitError for
    fewer groups.

    >>> found = recalls(torch.eye(40), torch.eye(40), range(40))
    >>> found["r1"], found["r3"]
    (100.0, 100.0)
    """
    members: dict[Hashable, list[int]] = {}
    for number, group in enumerate(groups):
        members.setdefault(group, []).append(number)
    if len(members) < among:
        raise MotionKitError(f"retrieval among {among} needs pairs of as many groups; found {len(members)}")
    generator, nearer, level = torch.Generator().manual_seed(seed), [], []
    several = list(members.values())
    for _ in range(rounds):
        chosen = torch.randperm(len(several), generator=generator)[:among].tolist()
        pick = [several[n][int(torch.randint(len(several[n]), (), generator=generator))] for n in chosen]
        near = similarity(motions[pick], texts[pick])
        nearer.append((near > near.diagonal()[:, None]).sum(1))
        level.append((near == near.diagonal()[:, None]).sum(1))  # the own one at least
    left, level = torch.cat(nearer).double(), torch.cat(level).double()
    return {f"r{k}": round(100 * float(((k - left) / level).clamp(0, 1).mean()), 2) for k in (1, 3)}
