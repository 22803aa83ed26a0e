"""Sentences: encoders that turn them into vectors, and rewriting them from style to neutral and back.

>>> to_neutral("an old person shuffles forward")
'a person walks forward neutrally'
"""

from __future__ import annotations

from ..errors import MotionKitError
from . import encoders
from .captions import style_in, to_neutral, to_style
from .encoders import CachedEncoder, TextEncoder, check_prompt, content_key, similarity

__all__ = [
    "CachedEncoder",
    "TextEncoder",
    "check_prompt",
    "content_key",
    "load",
    "similarity",
    "style_in",
    "to_neutral",
    "to_style",
]

_FORMS = "'mini', 'sentence-transformers:NAME_OR_FOLDER', 'clip:NAME_OR_FOLDER' or 'open-clip:ARCH@WEIGHTS'"


def load(name: str = "mini") -> TextEncoder:
    """A text encoder by name; those of other people come as `CachedEncoder`, since they are slow.

    name: "mini", the kit's own; "sentence-transformers:all-MiniLM-L6-v2" or a folder;
    "clip:openai/clip-vit-base-patch32" or a folder (through `transformers`); "open-clip:ViT-B-32@openai", where a file
    of weights may follow the @. Names are looked up on disk, then on the network. Raises MotionKitError for a name of
    another form, where packages are missing (`pip install -e .[text]`), and where a model is neither on disk nor to be
    had.

    >>> load("bert")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: no text encoder 'bert'; expected 'mini', ...
    """
    if name == "mini":
        return encoders.load_mini()
    kind, _, model = str(name).partition(":")
    if kind not in ("sentence-transformers", "clip", "open-clip") or not model.strip():
        raise MotionKitError(f"no text encoder {name!r}; expected {_FORMS}")
    make = {"sentence-transformers": encoders.sentence_transformer, "clip": encoders.clip}
    return CachedEncoder(make.get(kind, encoders.open_clip)(model))
