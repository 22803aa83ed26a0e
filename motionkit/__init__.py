"""motionkit: human motion style transfer, built step by step.

The names a newcomer needs stand here; everything else is one module away. Plotting and widgets load when first used.

>>> import motionkit as mk
>>> mk.load("data/actor/walk_neutral.bvh")
Motion('walk_neutral', 120 frames at 30 fps, 4.0 s, 22 joints)
"""

from __future__ import annotations

import importlib

from .bvh import MotionKitWarning, load, save
from .errors import MotionKitError
from .motion import Motion, concatenate
from .skeleton import Skeleton

__version__ = "0.1.0"

# public name -> where it lives; looked up on first use, so that `import motionkit` stays quick
_LAZY = {
    "Player": "viewer",
    "scene": "viewer",
    "strip": "viewer",
    "rotations": None,
    "keypoints": None,
    "kinematics": None,
    "layers": None,
    "features": None,
    "erd": None,
    "fewshot": None,
    "actor": None,
    "checkpoints": None,
    "contacts": None,
    "datasets": None,
    "diffusion": None,
    "judges": None,
    "arena": None,
    "methods": None,
    "metrics": None,
    "priors": None,
    "text": None,
    "retarget": "retargeting",
    "sampling": None,
    "video": None,
    "viewer": None,
    "exercises": None,
    "training": None,
}

__all__ = [
    "Motion",
    "MotionKitError",
    "MotionKitWarning",
    "Player",
    "Skeleton",
    "actor",
    "arena",
    "checkpoints",
    "concatenate",
    "contacts",
    "datasets",
    "diffusion",
    "exercises",
    "features",
    "erd",
    "fewshot",
    "judges",
    "keypoints",
    "kinematics",
    "layers",
    "load",
    "methods",
    "metrics",
    "priors",
    "text",
    "retarget",
    "rotations",
    "sampling",
    "save",
    "scene",
    "strip",
    "training",
    "video",
    "viewer",
]


def __getattr__(name: str):
    if name not in _LAZY:
        raise AttributeError(f"motionkit has no {name!r}; it has {', '.join(__all__)}")
    home = _LAZY[name]
    module = importlib.import_module(f".{home or name}", __name__)
    return getattr(module, name) if home else module


def __dir__() -> list[str]:
    return __all__
