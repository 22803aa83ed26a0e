"""Network parts that methods and judges share."""

from .stgcn import StGcn, StGcnConfig, spatial_partitions

__all__ = ["StGcn", "StGcnConfig", "spatial_partitions"]
