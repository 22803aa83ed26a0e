"""Dynamic time warping: against brute force, and on clips whose timing is known."""

import itertools

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import motionkit as mk
from motionkit.dtw import align, dtw, dtw_costs, gaussian_smooth, pose_velocity_features, warp


@pytest.fixture(scope="module")
def walk():
    return mk.load("data/actor/walk_neutral.bvh")


def paths(rows: int, columns: int, starts: list[int], ends: list[int]):
    """All monotone paths through a small matrix, as lists of cells."""
    todo = [[(0, j)] for j in starts]
    while todo:
        path = todo.pop()
        i, j = path[-1]
        if i == rows - 1 and j in ends:
            yield path
        for step in ((1, 1), (1, 0), (0, 1)):
            if i + step[0] < rows and j + step[1] < columns:
                todo.append([*path, (i + step[0], j + step[1])])


def cost_of(path: list, costs: torch.Tensor, penalty: float) -> float:
    steps = [(b[0] - a[0], b[1] - a[1]) for a, b in itertools.pairwise(path)]
    return float(sum(costs[i, j] for i, j in path)) + penalty * sum(s != (1, 1) for s in steps)


@given(st.integers(1, 4), st.integers(1, 5), st.booleans(), st.sampled_from([0.0, 0.3]), st.integers(0, 1000))
def test_no_path_is_cheaper(rows, columns, segment, penalty, seed):
    costs = torch.rand(rows, columns, generator=torch.Generator().manual_seed(seed))
    anywhere = list(range(columns))
    every = paths(rows, columns, anywhere if segment else [0], anywhere if segment else [columns - 1])
    least = min(cost_of(p, costs, penalty) for p in every)
    found = [tuple(cell) for cell in dtw(costs, step_penalty=penalty, segment=segment).tolist()]
    assert cost_of(found, costs, penalty) == pytest.approx(least, abs=1e-5)
    steps = {(b[0] - a[0], b[1] - a[1]) for a, b in itertools.pairwise(found)}
    assert steps <= {(1, 1), (1, 0), (0, 1)} and found[0][0] == 0 and found[-1][0] == rows - 1
    assert float(dtw_costs(costs[None], step_penalty=penalty, segment=segment)) == pytest.approx(least, abs=1e-5)


@pytest.mark.parametrize("segment", [False, True])
def test_many_at_once_cost_what_each_costs(segment):
    g = torch.Generator().manual_seed(1)
    lengths = [7, 3, 12]
    parts = [torch.rand(9, n, generator=g) for n in lengths]
    padded = torch.stack([torch.nn.functional.pad(p, (0, 12 - p.shape[1])) for p in parts])
    found = dtw_costs(padded, torch.tensor(lengths), step_penalty=0.1, segment=segment)
    alone = torch.cat([dtw_costs(p[None], step_penalty=0.1, segment=segment) for p in parts])
    assert torch.allclose(found, alone)


def test_a_clip_goes_along_with_itself(walk):
    costs = torch.cdist(pose_velocity_features(walk), pose_velocity_features(walk))
    assert torch.equal(dtw(costs), torch.arange(len(walk))[:, None].expand(-1, 2))
    assert torch.allclose(align(walk, walk), torch.arange(120.0), atol=1e-3)


def test_known_timing_is_found(walk):
    t = torch.linspace(0, 1, 120)
    uneven = 119 * (t + 0.1 * torch.sin(2 * torch.pi * t))
    found = align(walk.sample(uneven), walk)
    assert (found - uneven).abs().max() < 1.0
    assert (found[1:] >= found[:-1]).all()
    back = (walk.sample(found).positions() - walk.sample(uneven).positions()).norm(dim=-1)
    before = (walk.positions() - walk.sample(uneven).positions()).norm(dim=-1)
    assert back.mean() < 0.02 < 0.2 < before.mean()


def test_a_segment_is_found_where_it_was_cut(walk):
    turn = mk.load("data/actor/walk_turn_left_neutral.bvh")
    assert (align(turn[40:100], turn, segment=True) - torch.arange(40.0, 100.0)).abs().max() < 0.5
    whole = align(turn[40:100], turn)
    assert whole[0] < 20 and whole[-1] > len(turn) - 20  # without it, all of the other is used up


def test_how_somebody_holds_himself_does_not_matter(walk):
    """An old walk against a neutral one: steps fall together, though every joint is elsewhere."""
    p = mk.actor.perform("walk", "neutral", seed=5, seconds=4)
    old = mk.actor.retell(p, "old")
    found = align(old.motion, p.motion)
    low = found.floor().long().clamp(0, len(p) - 2)
    reached = torch.lerp(p.beats[low], p.beats[low + 1], (found - low).to(p.beats))
    assert (reached - old.beats).abs().mean() < 0.1  # of a step


def test_smoothing_keeps_the_ends_and_an_even_pace():
    line = torch.arange(50.0)[:, None] * 0.5
    assert torch.allclose(gaussian_smooth(line, 3.0), line, atol=1e-4)
    bumpy = line + torch.tensor([0.0, 0.4]).repeat(25)[:, None]
    assert torch.diff(gaussian_smooth(bumpy, 3.0), dim=0).std() < 0.1 * torch.diff(bumpy, dim=0).std()
    assert torch.equal(gaussian_smooth(line[:1], 3.0), line[:1])
    stalls = torch.tensor([[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [3, 3]])
    assert warp(stalls).tolist() == [0, 0, 1, 3]


def test_what_cannot_be_aligned_is_said(walk):
    with pytest.raises(mk.MotionKitError, match=r"expected costs \[F, G\].*found shape \[3\]"):
        dtw(torch.zeros(3))
    with pytest.raises(mk.MotionKitError, match=r"found shape \[0, 4\]"):
        dtw(torch.zeros(0, 4))
    with pytest.raises(mk.MotionKitError, match="not finite"):
        dtw(torch.tensor([[0.0, float("nan")]]))
    with pytest.raises(mk.MotionKitError, match="expected 2 lengths from 1 to 4"):
        dtw_costs(torch.zeros(2, 3, 4), torch.tensor([4, 5]))
    with pytest.raises(mk.MotionKitError, match="expected two motions"):
        align(walk, "walk.bvh")
    with pytest.raises(mk.MotionKitError, match="differ in joints or frame rate"):
        align(walk, walk.resample(60))
