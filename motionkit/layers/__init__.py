"""Network parts that the methods and the judges share."""

from __future__ import annotations

from ..methods.style_erd import (
    Branches,
    ContentNet,
    ErdConfig,
    ErdState,
    FtAttCritic,
    MultiClassCritic,
    StyleErd,
    attended,
)
from .graph import StGcn, StGcnBlock, StGcnConfig, spatial_partitions
from .transformer import (
    Denoiser,
    PoseEmbedding,
    PoseOutput,
    SemanticEncoder,
    TransformerConfig,
    encoder,
    semantic_loss,
    sinusoids,
)

__all__ = [
    "Branches",
    "ContentNet",
    "Denoiser",
    "ErdConfig",
    "ErdState",
    "FtAttCritic",
    "MultiClassCritic",
    "PoseEmbedding",
    "PoseOutput",
    "SemanticEncoder",
    "StGcn",
    "StGcnBlock",
    "StGcnConfig",
    "StyleErd",
    "TransformerConfig",
    "attended",
    "encoder",
    "semantic_loss",
    "sinusoids",
    "spatial_partitions",
]
