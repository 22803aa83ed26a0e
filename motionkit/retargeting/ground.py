"""Feet that stand in the source stand in the result: where, how high, and with as little bending as can be."""

from __future__ import annotations

import torch
from torch import Tensor

from ..contacts import _pelvis_drop, _sunk, foot_contacts, two_bone_ik
from ..motion import Motion
from .matching import SIDES, Body, Links

_SOLE = 0.08  # of a leg's length: a toe that is higher at rest does not stand on the ground there


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
    soles = [_sole(body, [foot[-1][n] for foot in pairs]) for n, body in enumerate((target, source))]
    levels = _levels(gaps, before, contacts, columns, (soles[0], soles[1] and soles[1] * scale))
    shifts = [_correction(gaps[:, c], levels[c], contacts[:, c]) for c in columns]
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


def _levels(
    gaps: Tensor,
    before: Tensor,
    contacts: Tensor,
    columns: tuple[Tensor, ...],
    soles: tuple[float | None, float | None],
) -> Tensor:
    """The gap in height [K] that each foot joint is to have while it stands: the same for both feet.

    gaps, before: [F, K, 3] metres. contacts: bool [F, K]. columns: the K of each leg, ankle first. soles: how high the
    outermost joints are over the ground at rest, on the target and on the source, where known. They stand that high,
    or else as high as the source's do. What is nearer to the ankle stands above them as the foot's shape has it.
    """
    levels = gaps.new_zeros(gaps.shape[1])
    outer = [int(c[-1]) for c in columns]
    height = _typical(before[..., 1], contacts, outer)
    wanted = 0.0 if soles[0] is None else soles[0] - (height if soles[1] is None else soles[1])
    lift = wanted - _typical(gaps[..., 1], contacts, outer)
    for place in range(max(map(len, columns))):
        mine = [int(c[-1 - place]) for c in columns if len(c) > place]
        levels[mine] = _typical(gaps[..., 1], contacts, mine) + lift
    return levels


def _typical(values: Tensor, contacts: Tensor, columns: list[int]) -> float:
    """The median of some columns of [F, K] over the frames that stand, or over all where none does."""
    chosen, stands = values[:, columns], contacts[:, columns]
    return float((chosen[stands] if bool(stands.any()) else chosen).median())


def _sole(body: Body, joints: list[int]) -> float | None:
    """How high above the ground some foot joints are in the rest pose, metres; None where that does not stand there."""
    heights = body.places[joints, 1] + float(body.skeleton.offsets[0, 1])
    sole, lowest = float(heights.mean()), float(body.places[:, 1].min() + body.skeleton.offsets[0, 1])
    leg = body.bone("left_hip", "left_knee") + body.bone("left_knee", "left_ankle")
    return sole if lowest >= -1e-3 and sole <= _SOLE * leg else None


def _correction(gaps: Tensor, levels: Tensor, stands: Tensor) -> Tensor:
    """How far to shift a leg's end, [F, 3], so that its gap to the source's stays as it is while the foot stands.

    gaps: [F, k, 3] of its foot joints, from the ankle outwards; levels: [k] the gaps in height to have; stands: bool
    [F, k]. In each contact the shift is 0 on average over the ground; before the first and after the last it holds.
    """
    frames, planted = len(gaps), stands.any(1)
    if not bool(planted.any()):
        up = (levels[-1] - gaps[:, -1, 1]).median()
        return up * gaps.new_tensor([0.0, 1.0, 0.0]).expand(frames, 3)
    outermost = stands.shape[1] - 1 - stands.flip(1).int().argmax(1)  # toes roll last
    rows = torch.arange(frames)
    steps = torch.zeros_like(gaps[:, 0])
    both = stands[1:] & stands[:-1]
    last = both.shape[1] - 1 - both.flip(1).int().argmax(1)
    steps[1:] = (gaps[1:] - gaps[:-1])[rows[1:] - 1, last] * both.any(1)[:, None]
    walk = -steps.cumsum(0)
    up = levels[outermost] - gaps[rows, outermost, 1]
    shift = torch.zeros_like(walk)
    number = (torch.diff(planted.int(), prepend=planted.new_zeros(1).int()) == 1).cumsum(0)
    for n in range(1, int(number.max()) + 1):
        mine = planted & (number == n)
        shift[mine] = walk[mine] - walk[mine].mean(0)
        shift[mine, 1] += up[mine].mean()
    return _bridged(shift, planted)


def _bridged(shift: Tensor, planted: Tensor) -> Tensor:
    """Frames [F, 3] that are not planted filled in from those around them, easing from one to the next."""
    known = planted.nonzero()[:, 0]
    rows = torch.arange(len(shift))
    after = torch.searchsorted(known, rows).clamp(max=len(known) - 1)
    before = (torch.searchsorted(known, rows, right=True) - 1).clamp(min=0)
    a, b = known[before], known[after]
    t = ((rows - a) / (b - a).clamp(min=1)).clamp(0, 1).to(shift)[:, None]
    return torch.lerp(shift[a], shift[b], t * t * (3 - 2 * t))


def _moved(result: Motion, legs: list[tuple], shifts: list[Tensor], planted: list[Tensor]) -> Motion:
    """The result with its pelvis moved by what the legs' shifts [F, 3] share, and the legs bent for the rest."""
    weights = [p.to(s)[:, None] + 0.1 for p, s in zip(planted, shifts, strict=True)]
    wide = max(1, round(result.fps * 0.1))
    weights = [_softened(w, wide) for w in weights]
    common = sum(w * s for w, s in zip(weights, shifts, strict=True)) / sum(weights)
    common = _softened(common, wide)
    translations = result.translations.clone()
    translations[:, 0] = translations[:, 0] + common
    places = result.positions()
    result = result.replace(translations=translations)
    if max(float((s - common).abs().max()) for s in shifts) < 1e-6:
        return result
    targets = [places[:, leg[2]] + shift for leg, shift in zip(legs, shifts, strict=True)]
    result = _sunk(result, _pelvis_drop(result, legs, targets, result.positions()))
    for leg, there in zip(legs, targets, strict=True):
        result = two_bone_ik(result, leg, there)
    return result


def _softened(values: Tensor, wide: int) -> Tensor:
    """A smooth running mean over time of [F, C], `wide` frames to either side; the ends hold."""
    weights = torch.hann_window(2 * wide + 3, periodic=False, dtype=values.dtype)[1:-1]
    padded = torch.nn.functional.pad(values.T[:, None], (wide, wide), mode="replicate")
    return torch.nn.functional.conv1d(padded, (weights / weights.sum())[None, None])[:, 0].T
