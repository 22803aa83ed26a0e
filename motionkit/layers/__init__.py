"""Network parts that the methods and the judges share."""

from .critics import ContentNet, FtAttCritic, MultiClassCritic, attended
from .stgcn import StGcn, StGcnBlock, StGcnConfig, spatial_partitions
from .style_erd import Branches, ErdConfig, ErdState, StyleErd
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
