"""Network parts that methods and judges share."""

from .stgcn import StGcn, StGcnBlock, StGcnConfig, spatial_partitions

__all__ = ["StGcn", "StGcnBlock", "StGcnConfig", "spatial_partitions"]
