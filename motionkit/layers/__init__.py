"""Network parts that no paper has to itself."""

from .graph import StGcn, StGcnBlock, StGcnConfig, spatial_partitions
from .lora import LoRA
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
    "LoRA",
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
