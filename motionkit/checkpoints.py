"""Weights on disk: NAME.safetensors, and beside it NAME.json, the card that says how they were made.

What the kit ships lies in `data/checkpoints`; weights that learned from captures under a licence of their own lie in a
folder there of that licence's name. The environment variable MOTIONKIT_CHECKPOINTS names another folder.

What can be kept is a `Checkpoint`: it says its networks, its facts and how it is put together again.
"""

from __future__ import annotations

import difflib
import hashlib
import json
import os
import platform
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar, TypeVar

import torch
from safetensors import SafetensorError
from safetensors.torch import load as read_tensors
from safetensors.torch import save as tensors_as_bytes
from torch import Tensor, nn

from .errors import MotionKitError
from .files import read_bytes, write_atomic
from .skeleton import Skeleton

FORMAT = 2  # to be raised when older code cannot read what newer code writes
# Licences of captures that forbid what MIT allows; weights that learned from them are under the same licence.
LICENCES = {"bandai-1": "CC-BY-NC-4.0", "bandai-2": "CC-BY-NC-4.0"}
_C = TypeVar("_C", bound="Checkpoint")
_N = TypeVar("_N", bound=nn.Module)


class Checkpoint:
    """What has weights on disk: a base class with one `save` and one `load`.

    A subclass sets `kind`, has a `card`, and writes `networks`, `tensors`, `facts` and `restore`.

    >>> import tempfile
    >>> @dataclass
    ... class Line(Checkpoint):
    ...     kind = "line"
    ...     network: nn.Module
    ...     card: dict = field(default_factory=dict)
    ...     def networks(self):
    ...         return {"network": self.network}
    ...     @classmethod
    ...     def restore(cls, saved):
    ...         return cls(saved.fill("network", nn.Linear(1, 1)), saved.card)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Line(nn.Linear(1, 1)).save(f"{folder}/a.safetensors")
    ...     Line.load(path).card["kind"]
    'line'
    """

    kind: ClassVar[str]
    card: dict

    def networks(self) -> dict[str, nn.Module]:
        """The networks by name: their weights are written with 16 bits."""
        return {}

    def tensors(self) -> dict[str, Tensor]:
        """Other tensors by name, written as they are."""
        return {}

    def facts(self) -> dict:
        """What the card says that `restore` needs."""
        return {}

    @classmethod
    def restore(cls: type[_C], saved: Saved, **given) -> _C:
        """Put together again from what was saved; given: what `load` was given beside the path."""
        raise NotImplementedError

    def save(self, path: str | os.PathLike) -> Path:
        """Write weights and card, each whole or not at all; returns the path of the weights, NAME.safetensors.

        Raises MotionKitError where the folder does not exist or a number is not finite.
        """
        tensors = dict(self.tensors())
        for name, network in self.networks().items():
            state = network.state_dict().items()
            tensors |= {f"{name}.{key}": value.half() if value.is_floating_point() else value for key, value in state}
        return save(path, tensors, {**self.card, "kind": self.kind, **self.facts()})

    @classmethod
    def load(cls: type[_C], path: str | os.PathLike, **given) -> _C:
        """From what `save` wrote. Raises MotionKitError if the files are missing, damaged, of another kind, of a newer
        format, of sizes that this version does not know, or do not belong to what is given."""
        return cls.restore(Saved.read(path, cls.kind), **given)


@dataclass
class Saved:
    """What a checkpoint's two files hold, and the questions that putting it together again asks."""

    path: Path
    card: dict
    tensors: dict[str, Tensor] = field(repr=False)

    @classmethod
    def read(cls, path: str | os.PathLike, kind: str) -> Saved:
        """From NAME.safetensors and NAME.json; MotionKitError as `load`."""
        tensors, card = load(path, kind)
        return cls(Path(path), card, tensors)

    def fill(self, name: str, network: _N) -> _N:
        """The saved weights in a network, which is then for use, not for training."""
        prefix = f"{name}."
        own = {key.removeprefix(prefix): value for key, value in self.tensors.items() if key.startswith(prefix)}
        own = {key: value.float() if value.is_floating_point() else value for key, value in own.items()}
        load_into(network, own, self.path)
        return network.eval().requires_grad_(False)

    def has(self, name: str) -> bool:
        """Whether there are weights of a network of this name."""
        return any(key.startswith(f"{name}.") for key in self.tensors)

    def config(self, sizes: type):
        """A network's sizes; sizes: a dataclass, such as `layers.TransformerConfig`.

        MotionKitError where they are not those that this version knows.
        """
        try:
            config = {k: tuple(v) if isinstance(v, list) else v for k, v in self.card["config"].items()}
            found = sizes(**config)
        except (KeyError, TypeError):
            raise MotionKitError(
                f"{self.path}: its card gives the sizes {self.card.get('config')}; this version's {sizes.__name__} has "
                f"{', '.join(sizes.__dataclass_fields__)}: get both files again, or another version of motionkit"
            ) from None
        return found

    def encoder(self, encoder):
        """The text encoder, if it is the one that these weights learned with; MotionKitError otherwise."""
        if encoder.key != self.card["text_key"]:
            raise MotionKitError(
                f"{self.path}: these weights learned from sentences as another {self.card['text_encoder']!r} encodes "
                f"them, and the one here is {encoder.name!r} with other weights; give the encoder they came with, or "
                "train them again"
            )
        return encoder

    @property
    def skeleton(self) -> Skeleton:
        """The skeleton that `skeleton_card` wrote down.

        >>> from motionkit.skeleton import smpl
        >>> Saved(Path("a"), {"skeleton": skeleton_card(smpl())}, {}).skeleton.same_tree(smpl())
        True
        """
        card = self.card["skeleton"]
        return Skeleton(tuple(card["names"]), tuple(card["parents"]), torch.tensor(card["offsets"]))


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


def default_path(data: str, what: str) -> Path:
    """Where weights that learn from a dataset go: `NAME-content.safetensors`, in the folder of its licence."""
    home = folder() / LICENCES.get(data, "").lower()
    os.makedirs(home, exist_ok=True)
    return home / f"{data}-{what}.safetensors"


def save(path: str | os.PathLike, tensors: Mapping[str, Tensor], card: Mapping) -> Path:
    """Write tensors and their card, each whole or not at all; returns the path of the tensors.

    path: ends in .safetensors. card: what JSON can hold; `kind` says what it is, such as "classifier". A hash of the
    tensors goes into the card, so that a pair that does not belong together is noticed. Raises MotionKitError where the
    folder does not exist or a number is not finite.

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
    text = _readable({**card, "format": FORMAT, "sha256": hashlib.sha256(data).hexdigest()})
    write_atomic(path, data)
    write_atomic(path.with_suffix(".json"), text + "\n")
    return path


def load(path: str | os.PathLike, kind: str | None = None) -> tuple[dict[str, Tensor], dict]:
    """Tensors and card of a checkpoint.

    kind: what it should be. Raises MotionKitError if a file is missing, damaged, belongs to other weights, is of
    another kind or of another format.
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
    if card["format"] < FORMAT:
        raise MotionKitError(
            f"{path}: written by an older motionkit (format {card['format']}); train or learn it again"
        )
    if card.get("sha256") != hashlib.sha256(data).hexdigest():
        raise MotionKitError(f"{path}: damaged, or its card is that of other weights; get both files again")
    if kind is not None and card.get("kind") != kind:
        raise MotionKitError(f"{path}: holds a {card.get('kind')!r}; expected a {kind!r}")
    try:
        return read_tensors(data), card
    except SafetensorError as error:
        raise MotionKitError(f"{path}: cannot be read ({error}); get it again") from None


def _weights(path: object, hint: str) -> Path:
    """The path of weights; MotionKitError for what is none."""
    if not isinstance(path, str | os.PathLike) or Path(path).suffix != ".safetensors":
        raise MotionKitError(f"{path}: {hint}")
    return Path(path)


def _readable(card: Mapping) -> str:
    """JSON with a line for each entry, but lists of numbers and names on one."""
    text = json.dumps(card, indent=2)
    return re.sub(r"\[\s+([^\[\]{}]*?)\s+\]", lambda found: f"[{' '.join(found[1].split())}]", text)


def load_into(model: nn.Module, tensors: Mapping[str, Tensor], where: str | os.PathLike) -> None:
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


def skeleton_card(skeleton: Skeleton) -> dict:
    """A skeleton for a card: names, parents, and offsets in metres to a micrometre."""
    offsets = [[round(x, 6) for x in row] for row in skeleton.offsets.tolist()]
    return {"names": list(skeleton.names), "parents": list(skeleton.parents), "offsets": offsets}


def training_card(data, config, run, network: nn.Module) -> dict:
    """What every card says of how weights were made.

    data: the Dataset that they learned from. config, run: a `training.TrainConfig` and the `training.Run` of it.
    """
    return {
        "data": data.name,
        "data_sha256": data_hash(data),
        "training_clips": len(data),
        "seed": config.seed,
        "steps": config.steps,
        "seconds": round(run.seconds),
        "steps_per_second": round(run.steps_per_second, 2),
        "hardware": hardware(),
        "parameters": sum(p.numel() for p in network.parameters()),
        "last_loss": round(run.last_loss, 4),
        "licence": LICENCES.get(data.name, "MIT"),
    }


def data_hash(dataset) -> str:
    """Changes when clips, their labels or their numbers do: 16 hexadecimal digits."""
    clips = (
        f"{dataset.store.clips[n].name} {dataset.store.clips[n].checksum} {tuple(dataset.labels[n][:2])}"
        for n in dataset.indices
    )
    return hashlib.sha256("\n".join(clips).encode()).hexdigest()[:16]


def hardware() -> str:
    """What a card says about the machine: cores, kind of processor, version of torch."""
    accelerator = torch.cuda.get_device_name() if torch.cuda.is_available() else f"{platform.machine()} CPU"
    return f"{os.cpu_count()} cores, {accelerator}, torch {torch.__version__.split('+')[0]}"
