"""Does a motion look like what a sentence says, for encoders of both that share a space?"""

from __future__ import annotations

import torch
from torch import Tensor

from ..errors import MotionKitError
from .checks import needs_finite, needs_tensor


def pair_similarities(motions: Tensor, texts: Tensor) -> Tensor:
    """The cosine between each motion's embedding and its own sentence's: [N], from -1 to 1.

    motions, texts: [N, D] from any two encoders into one space, row n of both belonging together. Raises MotionKitError
    for shapes that do not fit, rows that are not finite, and rows of zeros, which point nowhere.

    >>> pair_similarities(torch.tensor([[2.0, 0.0], [1.0, 1.0]]), torch.tensor([[1.0, 0.0], [-3.0, 3.0]]))
    tensor([1., 0.], dtype=torch.float64)
    """
    both = (("motions", motions), ("texts", texts))
    for name, x in both:
        needs_tensor("text similarity", f"{name} [N, D]", x)
    if motions.ndim != 2 or motions.shape != texts.shape or not motions.numel():
        raise MotionKitError(
            f"text similarity: expected embeddings [N, D] of motions and of their texts, one pair a row; found "
            f"{list(motions.shape)} and {list(texts.shape)}"
        )
    units = []
    for name, x in both:
        x = needs_finite("text similarity", name, x).detach().cpu().double()
        length = torch.linalg.vector_norm(x, dim=1, keepdim=True)
        if not (length > 0).all():
            raise MotionKitError(
                f"text similarity: {int((length == 0).sum())} of {len(x)} rows of {name} are all zeros and have no "
                "direction; look at what the encoder was given"
            )
        units.append(x / length)
    return (units[0] * units[1]).sum(1).clamp(-1, 1)


def text_similarity(motions: Tensor, texts: Tensor) -> float:
    """Mean cosine between motions and the sentences that describe them (paper 1, section 6.1, figure 8: CLIP score).

    motions, texts: [N, D], paired, as for `pair_similarities`, which gives the values behind the mean. 1 where every
    motion points where its sentence does, about 0 where they have nothing in common; how far above 0 is good depends on
    the encoders, so compare with shuffled pairs. Paper 1 takes its motion-semantic discriminator and CLIP.

    >>> x = torch.eye(3)
    >>> text_similarity(5 * x, x), text_similarity(x, x.roll(1, 0)), text_similarity(x, -x)
    (1.0, 0.0, -1.0)
    """
    return float(pair_similarities(motions, texts).mean())
