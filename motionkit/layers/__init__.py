"""Network parts that two methods or more share."""

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
    "Denoiser",
    "PoseEmbedding",
    "PoseOutput",
    "SemanticEncoder",
    "StGcn",
    "StGcnBlock",
    "StGcnConfig",
    "TransformerConfig",
    "encoder",
    "semantic_loss",
    "sinusoids",
    "spatial_partitions",
]
