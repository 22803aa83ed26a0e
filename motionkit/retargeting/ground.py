"""Feet that stand in the source stand in the result: where, how high, and with as little bending as can be."""

from __future__ import annotations

import torch
from torch import Tensor

from .. import rotations as rot
from ..contacts import foot_contacts, pelvis_drop, sunk, two_bone_ik
from ..motion import Motion
from .matching import SIDES, Body, Links

_SOLE = 0.05  # of the height: a toe that is higher at rest does not stand on the ground there


def stand(result: Motion, origin: Motion, target: Body, source: Body, links: Links, scale: float) -> Motion:
    """The result with standing feet moved as the source's move, times `scale`: mostly not at all.

    result, origin: motions on the two bodies' skeletons, the pelvis as root. Between contacts the correction passes
    smoothly from one to the next. The pelvis takes what both legs share, IK the rest. Where no leg has feet on both
    bodies, the motion is returned as it is.
    """
    pairs = _foot_pairs(target, source, links)
    if not pairs:
        return result
    flat = [p for foot in pairs for p in foot]
    contacts = foot_contacts(origin, [source.skeleton.names[s] for _, s in flat])
    before = origin.positions()[:, [s for _, s in flat]] * scale
    gaps = result.positions()[:, [t for t, _ in flat]] - before  # [F, K, 3]: constant while a foot does not slide
    columns = torch.arange(len(flat)).split([len(foot) for foot in pairs])
    outer = [int(c[-1]) for c in columns]
    heights, stands = before[:, outer, 1], contacts[:, outer]
    ground = float(torch.quantile(heights[stands] if bool(stands.any()) else heights.flatten(), 0.02))
    level = _level(ground, _sole(target, pairs, 0), _sole(source, pairs, 1), scale)
    shifts = [_correction(gaps[:, c], contacts[:, c], level) for c in columns]
    for n, shift in enumerate(shifts):  # a longer foot dips deeper as it swings: no deeper than to the ground
        under = heights[:, n].clamp(max=ground) + level - (heights[:, n] + gaps[:, outer[n], 1] + shift[:, 1])
        shift[:, 1] += under.clamp(min=0)
    legs = [tuple(target.skeleton.chain(foot[0][0])[-3:]) for foot in pairs]
    return _moved(result, legs, shifts, [contacts[:, c].any(1) for c in columns])


def _foot_pairs(target: Body, source: Body, links: Links) -> list[list[tuple[int, int]]]:
    """For each leg its (target, source) joints that touch the ground, from the ankle outwards."""
    feet = []
    for side in SIDES:
        roles = [f"{side}_{r}" for r in ("ankle", "toe")]
        both = [(target.roles[r], source.roles[r]) for r in roles if r in target.roles and r in source.roles]
        leg = [target.roles.get(f"{side}_{r}", -1) for r in ("hip", "knee", "ankle")]
        in_a_row = min(leg) > 0 and [target.skeleton.parents[j] for j in leg[1:]] == leg[:2]
        if both and in_a_row and all(links[j] for j in leg):
            feet.append(both)
    return feet


def _level(ground: float, target: float | None, source: float | None, scale: float) -> float:
    """How much higher the outermost foot joints are to stand than the source's do, times the scale; metres.

    ground: how high the source's stand in the clip, times the scale. target, source: how high they are over the ground
    at rest, where known. So they stand as high as at rest, or else as high as the source's.
    """
    if target is None:
        return 0.0
    return target - (ground if source is None else source * scale)


def _sole(body: Body, pairs: list[list[tuple[int, int]]], which: int) -> float | None:
    """How high above the ground a body's outermost foot joints are in the rest pose; None if that stands elsewhere."""
    heights = body.places[:, 1] + float(body.skeleton.offsets[0, 1])
    sole = float(heights[[foot[-1][which] for foot in pairs]].mean())
    return sole if float(heights.min()) > -1e-3 and sole < _SOLE * body.skeleton.height else None


def _correction(gaps: Tensor, stands: Tensor, level: float) -> Tensor:
    """How far to shift a leg's end, [F, 3], so that its gap to the source's stays as it is while the foot stands.

    gaps: [F, k, 3] of its foot joints, from the ankle outwards; stands: bool [F, k]; level: the gap in height that the
    outermost is to have. In each contact the shift is 0 on average over the ground. The outermost joint alone tells the
    height: where the ankle is over the ground changes as the foot rolls. Before the first and after the last it holds.
    """
    planted, up = stands.any(1), level - gaps[:, -1, 1]
    both = stands[1:] & stands[:-1]
    last = both.shape[1] - 1 - both.flip(1).int().argmax(1)  # toes roll last
    steps = torch.zeros_like(gaps[:, 0])
    steps[1:] = (gaps[1:] - gaps[:-1])[torch.arange(len(both)), last] * both.any(1)[:, None]
    walk = -steps.cumsum(0)
    shift = torch.zeros_like(walk)
    number = (torch.diff(planted.int(), prepend=planted.new_zeros(1).int()) == 1).cumsum(0)
    for n in range(1, int(number.max()) + 1):
        mine = planted & (number == n)
        shift[mine] = walk[mine] - walk[mine].mean(0)
    shift, tells = _bridged(shift, planted), stands[:, -1]
    shift[:, 1] = _bridged(up[:, None], tells)[:, 0] if bool(tells.any()) else up.median()
    return shift


def _bridged(shift: Tensor, planted: Tensor) -> Tensor:
    """Frames [F, C] that are not planted filled in from those around them, easing from one to the next."""
    if not bool(planted.any()):
        return shift
    known = planted.nonzero()[:, 0]
    rows = torch.arange(len(shift))
    after = torch.searchsorted(known, rows).clamp(max=len(known) - 1)
    before = (torch.searchsorted(known, rows, right=True) - 1).clamp(min=0)
    a, b = known[before], known[after]
    t = ((rows - a) / (b - a).clamp(min=1)).clamp(0, 1).to(shift)[:, None]
    return torch.lerp(shift[a], shift[b], t * t * (3 - 2 * t))


def _moved(result: Motion, legs: list[tuple], shifts: list[Tensor], planted: list[Tensor]) -> Motion:
    """The result with its pelvis moved by what the legs' shifts [F, 3] share, and the legs bent for the rest.

    A straight knee opens or closes by many degrees for a centimetre, a bent one by few: the straighter leg counts more.
    """
    places, wide = result.positions(), max(1, round(result.fps * 0.1))
    weights = []
    for leg, stands in zip(legs, planted, strict=True):
        a, b, c = (places[:, j] for j in leg)
        bent = (1 - (rot.normalize(b - a) * rot.normalize(c - b)).sum(-1, keepdim=True)).clamp(min=0)
        weights.append(_softened((stands[:, None] + 1.0) / (bent + 0.02), wide))
    common = sum(w * s for w, s in zip(weights, shifts, strict=True)) / sum(weights)
    common = _softened(common, wide)
    translations = result.translations.clone()
    translations[:, 0] = translations[:, 0] + common
    result = result.replace(translations=translations)
    if max(float((s - common).abs().max()) for s in shifts) < 1e-6:
        return result
    targets = [places[:, leg[2]] + shift for leg, shift in zip(legs, shifts, strict=True)]
    result = sunk(result, pelvis_drop(result, legs, targets, result.positions()))
    for leg, there in zip(legs, targets, strict=True):
        result = two_bone_ik(result, leg, there)
    return result


def _softened(values: Tensor, wide: int) -> Tensor:
    """A smooth running mean over time of [F, C], `wide` frames to either side; the ends hold."""
    weights = torch.hann_window(2 * wide + 3, periodic=False, dtype=values.dtype)[1:-1]
    padded = torch.nn.functional.pad(values.T[:, None], (wide, wide), mode="replicate")
    return torch.nn.functional.conv1d(padded, (weights / weights.sum())[None, None])[:, 0].T
