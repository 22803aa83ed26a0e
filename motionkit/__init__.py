"""motionkit: human motion style transfer, built step by step.

The names a newcomer needs stand here; everything else is one module away. Plotting and widgets load when first used.

>>> import motionkit as mk
>>> mk.load("data/actor/walk_neutral.bvh")
Motion('walk_neutral', 120 frames at 30 fps, 4.0 s, 22 joints)
"""

from __future__ import annotations

import importlib

from .bvh import load, save
from .errors import MotionKitError
from .files import MotionKitWarning, results
from .motion import Motion, concatenate
from .skeleton import Skeleton

__version__ = "0.1.0"

# looked up on first use, so that `import motionkit` stays quick
_FROM = {"Player": "viewer", "scene": "viewer", "strip": "viewer", "retarget": "retargeting", "exercises": "lessons"}
_MODULES = (
    "actor", "arena", "checkpoints", "contacts", "datasets", "diffusion", "dtw", "features", "judges", "kinematics",
    "layers", "lessons", "methods", "metrics", "rotations", "sampling", "text", "training", "video", "viewer",
)  # fmt: skip

__all__ = [
    "Motion",
    "MotionKitError",
    "MotionKitWarning",
    "Skeleton",
    "concatenate",
    "load",
    "results",
    "save",
    *sorted((*_FROM, *_MODULES)),
]


def __getattr__(name: str):
    if name in _FROM:
        module = importlib.import_module(f".{_FROM[name]}", __name__)
        found = getattr(module, name, module)
        globals()[name] = found  # a module of this name, once imported, would take its place
        return found
    if name in _MODULES:
        return importlib.import_module(f".{name}", __name__)
    raise AttributeError(f"motionkit has no {name!r}; it has {', '.join(__all__)}")


def __dir__() -> list[str]:
    return __all__
