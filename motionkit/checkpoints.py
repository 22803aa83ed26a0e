"""Weights on disk: NAME.safetensors, and beside it NAME.json, the card that says how they were made.

What the kit ships lies in `data/checkpoints`; weights that learned from captures under a licence of their own lie in a
folder there of that licence's name. The environment variable MOTIONKIT_CHECKPOINTS names another folder.
"""

from __future__ import annotations

import difflib
import hashlib
import json
import os
import platform
import re
from collections.abc import Mapping
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load as read_tensors
from safetensors.torch import save as tensors_as_bytes
from torch import Tensor

from .errors import MotionKitError
from .files import read_bytes, write_atomic
from .skeleton import Skeleton

FORMAT = 1  # to be raised when older code cannot read what newer code writes


def folder() -> Path:
    """Where shipped checkpoints are."""
    given = os.environ.get("MOTIONKIT_CHECKPOINTS")
    return Path(given).expanduser() if given else Path(__file__).resolve().parent.parent / "data" / "checkpoints"


def names() -> list[str]:
    """The shipped checkpoints, sorted."""
    return sorted(path.stem for path in folder().rglob("*.safetensors"))


def find(name: str) -> Path:
    """The file of a shipped checkpoint; MotionKitError names those that there are.

    >>> find("nobody-trained-this")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: no checkpoint 'nobody-trained-this' in ...
    """
    for path in sorted(folder().rglob("*.safetensors")):
        if path.stem == name:
            return path
    near = difflib.get_close_matches(str(name), names(), 1, 0.6)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise MotionKitError(
        f"no checkpoint {name!r} in {folder()}; {hint}There are: {', '.join(names()) or 'none'}. They come with the "
        "repository; MOTIONKIT_CHECKPOINTS can name another folder"
    )


def save(path: str | os.PathLike, tensors: Mapping[str, Tensor], card: Mapping) -> Path:
    """Write weights and their card, each whole or not at all; returns the path of the weights.

    path: ends in .safetensors. card: what JSON can hold; `kind` says what it is, such as "classifier". A hash of the
    weights goes into the card, so that a pair that does not belong together is noticed. Raises MotionKitError where
    the folder does not exist or a number is not finite.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as place:
    ...     path = save(f"{place}/a.safetensors", {"w": torch.ones(2)}, {"kind": "toy"})
    ...     load(path, "toy")[0]["w"]
    tensor([1., 1.])
    """
    path = _weights(path, "weights are written as .safetensors; name the file so")
    broken = [name for name, value in tensors.items() if not torch.isfinite(value).all()]
    if broken:
        raise MotionKitError(f"{path}: not written, {broken[0]!r} holds numbers that are not finite")
    plain = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
    data = tensors_as_bytes(plain)
    text = _readable({"format": FORMAT, **card, "sha256": hashlib.sha256(data).hexdigest()})
    write_atomic(path, data)
    write_atomic(path.with_suffix(".json"), text + "\n")
    return path


def _weights(path: object, hint: str) -> Path:
    """The path of weights; MotionKitError for what is none."""
    if not isinstance(path, str | os.PathLike) or Path(path).suffix != ".safetensors":
        raise MotionKitError(f"{path}: {hint}")
    return Path(path)


def _readable(card: Mapping) -> str:
    """JSON with a line for each entry, but lists of numbers and names on one."""
    text = json.dumps(card, indent=2)
    return re.sub(r"\[\s+([^\[\]{}]*?)\s+\]", lambda found: f"[{' '.join(found[1].split())}]", text)


def load(path: str | os.PathLike, kind: str | None = None) -> tuple[dict[str, Tensor], dict]:
    """Weights and card of a checkpoint.

    kind: what it should be. Raises MotionKitError if a file is missing, damaged, belongs to other weights, is of
    another kind or of a newer format.
    """
    path = _weights(path, "weights are .safetensors files, with their card beside them")
    data = read_bytes(path)
    try:
        card = json.loads(read_bytes(path.with_suffix(".json")))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise MotionKitError(
            f"{path.with_suffix('.json')}: no card can be read ({error}); get the pair again"
        ) from None
    if not isinstance(card, dict) or card.get("format", FORMAT + 1) > FORMAT:
        raise MotionKitError(f"{path}: written by a newer motionkit (format over {FORMAT}); update this one")
    if card.get("sha256") != hashlib.sha256(data).hexdigest():
        raise MotionKitError(f"{path}: damaged, or its card is that of other weights; get both files again")
    if kind is not None and card.get("kind") != kind:
        raise MotionKitError(f"{path}: holds a {card.get('kind')!r}; expected a {kind!r}")
    try:
        return read_tensors(data), card
    except SafetensorError as error:
        raise MotionKitError(f"{path}: cannot be read ({error}); get it again") from None


def load_into(model: torch.nn.Module, tensors: Mapping[str, Tensor], where: str | os.PathLike) -> None:
    """Weights into a network; MotionKitError names the first that is missing, left over or of another shape."""
    wanted = model.state_dict()
    for name in [*wanted, *tensors]:
        shapes = [list(part[name].shape) if name in part else None for part in (wanted, tensors)]
        if shapes[0] != shapes[1]:
            raise MotionKitError(
                f"{where}: {name} is {shapes[1] or 'missing'}, the network's {shapes[0] or 'unknown'}; these weights "
                "were trained with another configuration"
            )
    model.load_state_dict(tensors)


def load_config(path: str | os.PathLike, card: Mapping, sizes: type):
    """A network's sizes as its card says them; MotionKitError where they are not those that this version knows.

    sizes: a dataclass, such as `layers.TransformerConfig`.
    """
    try:
        return sizes(**card["config"])
    except (KeyError, TypeError):
        raise MotionKitError(
            f"{path}: its card gives the sizes {card.get('config')}; this version's {sizes.__name__} has "
            f"{', '.join(sizes.__dataclass_fields__)}: get both files again, or another version of motionkit"
        ) from None


def same_encoder(path: str | os.PathLike, card: Mapping, encoder):
    """The text encoder, if it is the one that these weights learned with; MotionKitError otherwise."""
    if encoder.key != card["text_key"]:
        raise MotionKitError(
            f"{path}: these weights learned from sentences as another {card['text_encoder']!r} encodes them, and the "
            f"one here is {encoder.name!r} with other weights; give the encoder they came with, or train them again"
        )
    return encoder


def skeleton_card(skeleton: Skeleton) -> dict:
    """A skeleton for a card: names, parents, and offsets in metres to a micrometre."""
    offsets = [[round(x, 6) for x in row] for row in skeleton.offsets.tolist()]
    return {"names": list(skeleton.names), "parents": list(skeleton.parents), "offsets": offsets}


def skeleton_of(card: dict) -> Skeleton:
    """The skeleton that `skeleton_card` wrote down.

    >>> from motionkit.skeleton import smpl
    >>> skeleton_of(skeleton_card(smpl())).same_tree(smpl())
    True
    """
    return Skeleton(tuple(card["names"]), tuple(card["parents"]), torch.tensor(card["offsets"]))


def hardware() -> str:
    """What a card says about the machine: cores, kind of processor, version of torch."""
    accelerator = torch.cuda.get_device_name() if torch.cuda.is_available() else f"{platform.machine()} CPU"
    return f"{os.cpu_count()} cores, {accelerator}, torch {torch.__version__.split('+')[0]}"
