"""Text encoders of other people, on the CPU: sentence-transformers, CLIP through transformers, and open_clip.

Their packages are imported when one is asked for: `pip install -e .[text]`.
"""

from __future__ import annotations

import importlib
import json
import logging
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from ..errors import MotionKitError
from ..files import MotionKitWarning
from .encoder import TextEncoder, content_key

# Of a configuration: what says how or by whom a model was saved, not what it answers.
_BESIDES = ("_name_or_path", "transformers_version", "architectures", "dtype", "torch_dtype")


class Pretrained(TextEncoder):
    """A text encoder that somebody else trained.

    name: as `text.load` takes it. network: frozen here, in float32. run: up to `batch` sentences to vectors [N, E].
    states: what the answers depend on beside the weights, as text. count: sentences to numbers of tokens; those with
    more than `limit` are cut, with a MotionKitWarning. weights: of the network, which to count for the key.

    >>> network = nn.Linear(1, 3)
    >>> encoder = Pretrained("lengths", network, lambda texts: network(torch.tensor([[float(len(t))] for t in texts])))
    >>> encoder.encode(["a person walks"]).shape, encoder.size
    (torch.Size([1, 3]), 3)
    """

    def __init__(
        self,
        name: str,
        network: nn.Module,
        run: Callable[[list[str]], Tensor],
        states: Sequence[str] = (),
        *,
        count: Callable[[list[str]], list[int]] | None = None,
        limit: int | None = None,
        weights: Callable[[str], bool] = lambda name: True,
    ) -> None:
        self.name = name
        self.network = network.float().eval().requires_grad_(False)
        self._run, self._count, self._limit = run, count, limit
        self.key = content_key({k: v for k, v in network.state_dict().items() if weights(k)}, *states)
        with torch.no_grad():
            self.size = run(["a person walks"]).shape[1]

    def embed(self, texts: list[str]) -> Tensor:
        """The vectors [N, E]."""
        if self._count is not None and self._limit is not None:
            for text, tokens in zip(texts, self._count(texts)):
                if tokens > self._limit:
                    warnings.warn(
                        f"{self.name} reads {self._limit} tokens; of the {tokens} of {text[:40]!r}... the last do not "
                        "count; say it in fewer words",
                        MotionKitWarning,
                        stacklevel=3,
                    )
        return self._run(texts)


def sentence_transformer(model: str) -> Pretrained:
    """A model of sentence-transformers on the CPU. model: its name, or a folder that it was saved to.

    Raises MotionKitError where the package is missing, and where the model is neither on disk nor to be had.

    >>> sentence_transformer("./nowhere")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: text encoder 'sentence-transformers:./nowhere': no such folder; check the path
    """
    name = f"sentence-transformers:{model}"
    place = _place(name, model)
    package = _package(name, "sentence_transformers", "pip install -e .[text]")
    with _loading(name):
        make = package.SentenceTransformer
        made = _local_first(place, lambda where, local: make(where, device="cpu", local_files_only=local))
        tokenizer = made.tokenizer
        states = [repr(made), str(made.max_seq_length), json.dumps([made.prompts, made.default_prompt_name])]
        config = getattr(getattr(made[0], "auto_model", None), "config", None)
        states += [_config(config) if config is not None else "", _tokenizer(tokenizer)]

        def run(texts: list[str]) -> Tensor:
            return made.encode(texts, batch_size=len(texts), convert_to_tensor=True, show_progress_bar=False)

        count = _counter(tokenizer) if callable(tokenizer) else None
        return Pretrained(name, made, run, states, count=count, limit=made.max_seq_length)


def clip(model: str) -> Pretrained:
    """The text tower of a CLIP model with its projection, through transformers, on the CPU.

    model: its name, or a folder that a CLIPModel or CLIPTextModelWithProjection and its tokenizer were saved to. Raises
    MotionKitError where the package is missing, where the model is neither on disk nor to be had, and where it has no
    such tower.

    >>> clip("./nowhere")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: text encoder 'clip:./nowhere': no such folder; check the path
    """
    name = f"clip:{model}"
    place = _place(name, model)
    package = _package(name, "transformers", "pip install -e .[text]")
    with _loading(name):

        def load(where: str, local: bool) -> tuple[Any, Any, Any]:
            made = package.CLIPTextModelWithProjection
            tower = made.from_pretrained(where, local_files_only=local, output_loading_info=True)
            return *tower, package.AutoTokenizer.from_pretrained(where, local_files_only=local)

        network, info, tokenizer = _local_first(place, load)
        if info["missing_keys"]:
            raise MotionKitError(
                f"text encoder {name!r}: no text tower of CLIP there ({sorted(info['missing_keys'])[0]} is missing); "
                "give a CLIP model"
            )
        limit = network.config.max_position_embeddings

        def run(texts: list[str]) -> Tensor:
            tokens = tokenizer(texts, padding=True, truncation=True, max_length=limit, return_tensors="pt")
            return network(input_ids=tokens["input_ids"], attention_mask=tokens["attention_mask"]).text_embeds

        states = (_config(network.config), _tokenizer(tokenizer))
        return Pretrained(name, network, run, states, count=_counter(tokenizer), limit=limit)


def open_clip(model: str) -> Pretrained:
    """The text tower of a model of open_clip, on the CPU.

    model: ARCH@WEIGHTS, such as "ViT-B-32@openai", with a file of weights or the tag of published ones; or a folder
    with open_clip_config.json and the weights. Raises MotionKitError where the package is missing, for an architecture
    that it does not know, and where the weights are neither on disk nor to be had.

    >>> open_clip("ViT-B-32")
    Traceback (most recent call last):
    ...
    motionkit.errors.MotionKitError: text encoder 'open-clip:ViT-B-32': expected ARCH@WEIGHTS, such as ...
    """
    name, (arch, _, weights) = f"open-clip:{model}", model.partition("@")
    folder, file = Path(model).expanduser(), Path(weights).expanduser()
    if not folder.is_dir() and not (arch and weights):
        raise MotionKitError(f"text encoder {name!r}: expected ARCH@WEIGHTS, such as ViT-B-32@openai, or a folder")
    if (weights.startswith((".", "~")) or len(file.parts) > 1) and not file.is_file():
        raise MotionKitError(f"text encoder {name!r}: no such file of weights; check the path")
    package = _package(name, "open_clip", "pip install open_clip_torch, and torchvision of the same build as torch")
    with _loading(name):
        if folder.is_dir():
            arch, weights = f"local-dir:{folder}", None
        elif arch not in package.list_models():
            raise MotionKitError(
                f"text encoder {name!r}: open_clip has no architecture {arch!r}; open_clip.list_models() names them"
            )
        known = str(file) if weights and file.is_file() else weights
        network = package.create_model(arch, pretrained=known, device="cpu", require_pretrained=True)
        tokenizer = package.get_tokenizer(arch)
        return _open_clip_tower(name, network, tokenizer)


def _open_clip_tower(name: str, network: nn.Module, tokenizer: Any) -> Pretrained:
    def run(texts: list[str]) -> Tensor:
        return network.encode_text(tokenizer(texts))

    inner = getattr(tokenizer, "tokenizer", None)  # of transformers; else open_clip's own
    words = _tokenizer(inner) if inner is not None else json.dumps(sorted(tokenizer.encoder.items()))
    states = (repr(network), words, str(tokenizer.context_length))
    return Pretrained(name, network, run, states, weights=lambda key: not key.startswith("visual."))


def _place(name: str, model: str) -> str:
    """A folder as a path, or a name as it is; MotionKitError for what can only be a folder and is none."""
    place = Path(model).expanduser()
    if place.is_dir():
        return str(place)
    if place.is_absolute() or model.startswith((".", "~")) or "\\" in model or model.count("/") > 1:
        raise MotionKitError(f"text encoder {name!r}: no such folder; check the path")
    return model


def _local_first(where: str, load: Callable[[str, bool], Any]) -> Any:
    """What is loaded from disk (a folder, or the cache of what was downloaded before) or else from the network."""
    try:
        return load(where, True)
    except (OSError, ValueError):
        if Path(where).is_dir():
            raise
    _reach_network()
    return load(where, False)


def _reach_network() -> None:
    """OSError within seconds where there is no network; the packages themselves try for a minute."""
    try:
        from huggingface_hub import constants
        from huggingface_hub.utils import get_session

        get_session().head(constants.ENDPOINT, timeout=5)
    except ImportError:
        return
    except Exception as error:  # of whichever client it uses
        raise OSError("it is not on disk, and the network cannot be reached") from error


def _package(name: str, module: str, how: str) -> Any:
    """A package that not everybody has; MotionKitError says how to get it."""
    try:
        with _quiet():
            return importlib.import_module(module)
    except Exception as error:  # a torchvision of another build than torch raises a RuntimeError
        raise MotionKitError(
            f"text encoder {name!r} needs the package {module}, which cannot be imported ({_first_line(error)}); {how}"
        ) from None


@contextmanager
def _loading(name: str) -> Iterator[None]:
    """Loading without the packages' chatter, and with one kind of error."""
    try:
        with _quiet():
            yield
    except MotionKitError:
        raise
    except Exception as error:  # the packages raise what they like
        raise MotionKitError(
            f"text encoder {name!r} cannot be loaded: {_first_line(error)}. Give a folder that has all its files, or a "
            "name that is right, with the network at hand for the first time"
        ) from None


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0].rstrip(".")[:200]


@contextmanager
def _quiet() -> Iterator[None]:
    """No log lines (errors are raised), no warnings and no bars of transformers; all as before afterwards."""
    before, bars = logging.root.manager.disable, None
    with suppress(ImportError):
        from transformers.utils import logging as bars
    shown = bars is not None and bars.is_progress_bar_enabled()
    try:
        logging.disable(max(before, logging.ERROR))
        if shown:
            bars.disable_progress_bar()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)
        if shown:
            bars.enable_progress_bar()


def _config(config: Any) -> str:
    """A model's configuration as text."""
    told = {key: value for key, value in config.to_dict().items() if key not in _BESIDES}
    return json.dumps(told, sort_keys=True, default=str)


def _tokenizer(tokenizer: Any) -> str:
    """A tokenizer's words and rules as text, without what changes from call to call."""
    rules = getattr(tokenizer, "backend_tokenizer", None)
    if rules is None:
        words = tokenizer.get_vocab() if hasattr(tokenizer, "get_vocab") else repr(tokenizer)
        return json.dumps(words, sort_keys=True, default=str)
    told = json.loads(rules.to_str())
    return json.dumps({key: value for key, value in told.items() if key not in ("padding", "truncation")})


def _counter(tokenizer: Any) -> Callable[[list[str]], list[int]]:
    def count(texts: list[str]) -> list[int]:
        with _quiet():  # it warns of long sentences itself, but not always
            return [len(ids) for ids in tokenizer(texts, truncation=False, padding=False)["input_ids"]]

    return count
