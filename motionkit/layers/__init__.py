"""Network parts that the methods and the judges share."""

from .stgcn import StGcn, StGcnBlock, StGcnConfig, spatial_partitions
from .transformer import (
    Denoiser,
    PoseEmbedding,
    SemanticEncoder,
    TransformerConfig,
    encoder,
    semantic_loss,
    sinusoids,
)

__all__ = [
    "Denoiser",
    "PoseEmbedding",
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
