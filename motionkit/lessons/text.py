"""Pictures of meaning: how near sentences are to one another, and motions to sentences."""

from __future__ import annotations

import html
import warnings
from collections.abc import Sequence

import ipywidgets
import torch
from torch import Tensor
from torch.nn import functional

from ..errors import MotionKitError
from ..files import MotionKitWarning
from ..methods.text_to_motion import GUIDANCE_SCALE
from ..motion import Motion
from ..text import similarity
from ..viewer.figure import StillWidget
from ..viewer.player import Player
from ..viewer.plots import INK, SOFT, StaticFigure, strip
from . import Exercise, seeded_randn

_WRITTEN = 14  # rows and columns up to which numbers are written into the cells


def plot_similarity(
    near: Tensor,
    rows: Sequence[str],
    columns: Sequence[str] | None = None,
    *,
    title: str = "",
    marks: Sequence[tuple[int, int]] = (),
) -> StaticFigure:
    """A table of cosines as shades: white for 0 and below, dark blue for 1.

    near: [N, M], as `mk.text.similarity` gives. rows, columns: N and M texts; columns are the rows if left out. marks:
    cells (row, column) with a frame around them, such as the right answers. Small tables have their numbers in them.
    Returns the matplotlib Figure. Raises MotionKitError where there are not as many texts as rows or columns.

    >>> import torch
    >>> picture = plot_similarity(torch.eye(2), ["a person walks", "a person kicks"])
    >>> [text.get_text() for text in picture.axes[0].texts]
    ['1.00', '0.00', '0.00', '1.00']
    """
    columns = rows if columns is None else columns
    if near.ndim != 2 or tuple(near.shape) != (len(rows), len(columns)):
        raise MotionKitError(
            f"plot_similarity: expected a table [{len(rows)}, {len(columns)}], a text for each row and column; found "
            f"{list(near.shape)}"
        )
    small = max(near.shape) <= _WRITTEN
    picture = StaticFigure(figsize=_size(rows, columns, small), dpi=105, layout="constrained")
    ax = picture.add_subplot()
    ax.imshow(near.detach().cpu().numpy(), cmap="Blues", vmin=0, vmax=1, aspect="auto")
    _name(ax, rows, columns, small)
    ax.set_title(title, fontsize=10, color=SOFT, loc="left")
    if small:
        _write(ax, near)
    for row, column in marks:
        ax.add_patch(_frame(row, column))
    return picture


def _size(rows: Sequence[str], columns: Sequence[str], small: bool) -> tuple[float, float]:
    """Of the picture, inches: room for the cells, and for the longest texts beside and under them."""
    cell, beside, under = (0.46, 0.085, 0.05) if small else (0.2, 0.065, 0.065)
    wide = cell * len(columns) + beside * max(map(len, rows)) + 0.4
    return wide, 0.85 * cell * len(rows) + under * max(map(len, columns)) + 0.5


def _name(ax: object, rows: Sequence[str], columns: Sequence[str], small: bool) -> None:
    slant = {"rotation": 35 if small else 90, "ha": "right", "va": "top" if small else "center"}
    letters = {"fontsize": 8.5 if small else 6.5, "color": INK}
    ax.set_yticks(range(len(rows)), rows, **letters)
    ax.set_xticks(range(len(columns)), columns, rotation_mode="anchor", **slant, **letters)
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)


def _write(ax: object, near: Tensor) -> None:
    for row, values in enumerate(near.tolist()):
        for column, value in enumerate(values):
            ink = "white" if value > 0.6 else INK
            ax.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=8, color=ink)


def _frame(row: int, column: int) -> object:
    from matplotlib.patches import Rectangle

    return Rectangle((column - 0.5, row - 0.5), 1, 1, fill=False, edgecolor="#d3622b", linewidth=1.2)


PROMPT = "a person walks in depression"
# kind of message: its colour, on white and on the page
_TINTS = {"said": SOFT, "warning": "#9a6200", "error": "#b3261e"}


class MessageBox(StillWidget, ipywidgets.HBox):
    """Controls in a column on the left, under them a message, and on the right a player.

    `controls`: name to widget. `message`: what stands under them.
    """

    def __init__(self, player: Player, controls: dict[str, ipywidgets.Widget], column: Sequence) -> None:
        self.player, self.controls = player, controls
        self._text = ipywidgets.HTML(layout={"width": "290px"})
        left = ipywidgets.VBox([*column, self._text], layout={"width": "310px", "padding": "4px 8px 0 0"})
        show = ipywidgets.Box([player], layout={"flex": "1 1 360px", "min_width": "300px", "display": "block"})
        super().__init__([left, show], layout={"flex_flow": "row wrap"})

    def _tell(self, kind: str, text: str) -> None:
        """Write the message: as something said, a warning or an error."""
        self._kind, self.message, shown = kind, text, html.escape(text)
        self._text.value = f'<div style="color: {_TINTS[kind]}; line-height: 1.35; padding-top: 6px">{shown}</div>'

    def _write_message(self, picture: StaticFigure, ink: str = SOFT) -> None:
        """The message at the bottom of a still; ink: of what is neither a warning nor an error."""
        text = self.message if len(self.message) < 130 else f"{self.message[:127]}..."
        colour = ink if self._kind == "said" else _TINTS[self._kind]
        picture.text(0.025, 0.05, text, fontsize=8.5, color=colour, va="center")


class PromptBox(MessageBox):
    """A sentence on the left, and on the right a player with the motion that a prior makes of it.

    Press Enter and the player follows, and so it does at every move of a slider; "another" asks the same again from
    other noise. Under the controls stands which known sentence is nearest, and how near (cosine). What is wrong with a
    sentence is told there too: an empty one makes nothing and the motion before stays, one far from all that is known
    is performed with a warning.

    prior: a `text_to_motion.Prior`, or anything with its `generate`, `longest`, `fps`, `guided`, `encoder`,
    `train_captions` and `caption_embeddings`. seconds: of the motion, at most what the prior learned from; 4, or that,
    if left out. scale: of guidance; `text_to_motion.GUIDANCE_SCALE` if left out, where it can be guided. steps: of the
    sampler. seed: of the noise. Raises MotionKitError if the first sentence, or a number, will not do. Source: paper 1,
    section 3.3, with a box around it.

    controls: "prompt", "seconds", "scale" and "seed", name to widget; set their values and the box follows. `motion` is
    what is shown, `message` what stands under the controls.

    >>> import motionkit as mk
    >>> box = PromptBox(mk.methods.text_to_motion.load("actor"), "a person waves", seconds=2)
    >>> box.controls["prompt"].value = "an old person walks"
    >>> box.motion
    Motion('an old person walks', 60 frames at 30 fps, 2.0 s, 22 joints)
    >>> box.controls["prompt"].value = " "
    >>> box.message, box.motion.name
    ("the prompt is empty; say what someone does, such as 'a person walks'; found ' '", 'an old person walks')
    """

    about = "a prompt box"

    def __init__(
        self,
        prior: object,
        prompt: str = PROMPT,
        *,
        seconds: float | None = None,
        scale: float | None = None,
        steps: int = 20,
        seed: int = 0,
    ) -> None:
        _check_prior(prior)
        self._prior, self._steps = prior, steps
        scale = (GUIDANCE_SCALE if prior.guided else 1.0) if scale is None else scale
        seconds = min(4.0, prior.longest / prior.fps) if seconds is None else seconds
        self._near = _nearest(prior, prompt)
        self.motion, message = _answer(prior, prompt, seconds=seconds, scale=scale, steps=steps, seed=seed)
        controls = _controls(prior, prompt, seconds, scale, seed)
        self._go = _button("move", "Make a motion of this sentence", "primary")
        self._more = _button("another", "The same sentence from other noise", "")
        prompt, *numbers = controls.values()
        column = [prompt, ipywidgets.HBox([self._go, self._more]), *numbers]
        super().__init__(Player(self.motion, height=360), controls, column)
        self._tell(*message)
        self._asked = self.values()
        for control in self.controls.values():
            control.observe(lambda _: self._follow(), "value")
        self._go.on_click(lambda _: self._follow())
        self._more.on_click(lambda _: self._another())

    def values(self) -> dict:
        """The controls' values by name."""
        return {name: control.value for name, control in self.controls.items()}

    def _another(self) -> None:
        seed = self.controls["seed"]
        seed.value = seed.value + 1 if seed.value < seed.max else seed.min

    def _follow(self) -> None:
        """Make a motion of what the controls say, unless that is what is shown."""
        values = self.values()
        if values == self._asked:
            return
        self._asked = values
        self._go.disabled = self._more.disabled = True
        self._go.description = "moving ..."
        try:
            prompt = values.pop("prompt")
            near = _nearest(self._prior, prompt)
            motion, message = _answer(self._prior, prompt, steps=self._steps, **values)
            self.player.set_motions(motion)
            self.motion, self._near = motion, near
            self._tell(*message)
        except MotionKitError as error:
            self._tell("error", str(error))
        finally:
            self._asked = self.values()
            self._go.description, self._go.disabled, self._more.disabled = "move", False, False

    def _tell(self, kind: str, text: str) -> None:
        super()._tell(kind, text or self._near)

    def still(self) -> bytes:
        """The sentence, poses of the motion made of it, and the message, as the bytes of a PNG."""
        picture = StaticFigure(figsize=(8.6, 3.0), dpi=100)
        box = {"boxstyle": "round,pad=0.45", "facecolor": "white", "edgecolor": "#9aa5b1"}
        picture.text(0.035, 0.9, self.motion.name, fontsize=12, color=INK, va="center", bbox=box)
        strip(self.motion, poses=9, ax=picture.add_axes((0, 0.1, 1, 0.72)))
        self._write_message(picture)
        return picture.png()


def _check_prior(prior: object) -> None:
    needed = ("generate", "longest", "fps", "guided", "encoder", "train_captions", "caption_embeddings")
    missing = [name for name in needed if not hasattr(prior, name)]
    if missing:
        raise MotionKitError(
            f"PromptBox: expected a prior, such as mk.methods.text_to_motion.load('actor'); found {prior!r:.60}, which "
            f"has no {', '.join(missing)}"
        )


def _answer(prior: object, prompt: str, **asked: object) -> tuple[Motion, tuple[str, str]]:
    """A motion of the sentence, and the kind and text of what has to be said about it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", MotionKitWarning)
        motion = prior.generate(prompt, **asked)[0]
    texts = []
    for warning in caught:
        if issubclass(warning.category, MotionKitWarning):
            texts.append(str(warning.message))
        else:
            warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)
    text = " ".join(dict.fromkeys(texts))
    return motion, ("warning" if text else "said", text)


def _nearest(prior: object, prompt: str) -> str:
    """Which of the sentences that it learned from is nearest, in words; nothing where there is no sentence."""
    if not isinstance(prompt, str) or not prompt.strip():
        return ""
    near = similarity(prior.encoder.encode([prompt]), prior.caption_embeddings)[0]
    best = int(near.argmax())
    return f"nearest known: {prior.train_captions[best]!r}, similarity {float(near[best]):.2f}"


def _button(text: str, about: str, style: str) -> ipywidgets.Button:
    return ipywidgets.Button(description=text, tooltip=about, button_style=style, layout={"width": "110px"})


def _controls(prior: object, prompt: str, seconds: float, scale: float, seed: int) -> dict[str, ipywidgets.Widget]:
    """The sentence, and three numbers; each tells its new value when it is let go, not while it moves."""
    wide = {"continuous_update": False, "layout": {"width": "300px"}}
    longest = prior.longest / prior.fps
    return {
        "prompt": ipywidgets.Text(value=prompt, placeholder="say what someone does, and how", **wide),
        "seconds": ipywidgets.FloatSlider(
            value=seconds, min=min(0.5, longest), max=longest, step=0.1, description="seconds", **wide
        ),
        "scale": ipywidgets.FloatSlider(
            value=scale, min=1.0, max=max(8.0, scale), step=0.1, description="guidance", disabled=not prior.guided,
            readout_format=".1f", **wide,
        ),
        "seed": ipywidgets.BoundedIntText(value=seed, min=0, max=2**31 - 1, description="seed", **wide),
    }  # fmt: skip


def _tokens() -> dict[str, tuple]:
    """Queries, keys and values [N, D], and which tokens exist, bool [N]."""
    q, k, v = (seeded_randn(6, 4, seed=seed) for seed in range(3))
    there = torch.arange(6) < 4
    return {
        "all are there": (q, k, v, there | True),
        "two are padding": (q, k, v, there),
        "large numbers in the padding": (q, k + 30 * ~there[:, None], v + 1e3 * ~there[:, None], there),
    }


def _masked_attention(q: Tensor, k: Tensor, v: Tensor, there: Tensor) -> Tensor:
    """What each token hears, [N, D], from the tokens that are there."""
    return functional.scaled_dot_product_attention(q, k, v, there.expand(len(q), -1))


def _scores(q: Tensor, k: Tensor) -> Tensor:
    return q @ k.T / q.shape[1] ** 0.5


def _recall_at(near: Tensor, k: int) -> Tensor:
    """In which share of the rows of a similarity [N, N] the own column is among the k largest, 0 to 1."""
    return ((near > near.diagonal()[:, None]).sum(1) < k).double().mean()


def _pairs() -> dict[str, tuple]:
    """Motions and texts [N, E] that ask for gradients, and the temperature."""
    motions, texts = seeded_randn(6, 8), 3 * seeded_randn(6, 8, seed=1)
    return {
        "vectors at right angles": (torch.eye(4).requires_grad_(), torch.eye(4).requires_grad_(), 0.1),
        "random vectors": (motions.requires_grad_(), texts.requires_grad_(), 0.5),
    }


def _contrastive_loss(motions: Tensor, texts: Tensor, temperature: float) -> Tensor:
    """Cross-entropy of telling each motion's own sentence from the others of the batch."""
    return _own_is_right(similarity(motions, texts) / temperature)


def _own_is_right(scores: Tensor) -> Tensor:
    """Cross-entropy of scores [N, N] in which answer n is right for question n."""
    return functional.cross_entropy(scores, torch.arange(len(scores)))


EXERCISES = {
    "contrastive_loss": Exercise(
        _contrastive_loss,
        cases=_pairs,
        hints=(
            "each motion is asked which of N sentences is its own: what loss does a classifier have?",
            "first vectors of length 1, then all products [N, N] divided by the temperature; row n is a question with "
            "N answers, of which n is right: minus the logarithm of its share after softmax, and the mean of that.",
            "cross_entropy of (motions @ texts.T / temperature), both scaled to length 1, with torch.arange(N).",
        ),
        mistakes={
            "Cosines: scale all vectors to length 1 first.": lambda x, y, t: _own_is_right(x @ y.T / t),
            "Divide by the temperature: a small one makes differences large.": lambda x, y, t: _contrastive_loss(
                x, y, 1 / t
            ),
            "A row is a question: softmax over the sentences, dimension 1.": lambda x, y, t: _contrastive_loss(y, x, t),
            "The mean over the batch, not the sum.": lambda x, y, t: len(x) * _contrastive_loss(x, y, t),
            "Return the tensor: no gradient flows through a plain number.": lambda *case: _contrastive_loss(
                *case
            ).item(),
        },
    ),
    "masked_attention": Exercise(
        _masked_attention,
        cases=_tokens,
        hints=(
            "what must a score be, so that its share after the softmax is exactly 0?",
            "scores are q @ k.T divided by the root of D; those of tokens that are not there become minus infinity "
            "before the softmax, not zero after it.",
            "scores.masked_fill(~there, -torch.inf).softmax(1) @ v: a column for each one who is listened to.",
        ),
        mistakes={
            "The padding is heard: the mask was not used.": lambda q, k, v, there: _scores(q, k).softmax(1) @ v,
            "Shares that are set to 0 after the softmax leave a sum below 1: mask the scores before it.": (
                lambda q, k, v, there: (_scores(q, k).softmax(1) * there) @ v
            ),
            "A score of 0 still gets a share, since exp(0) = 1: minus infinity.": lambda q, k, v, there: (
                (_scores(q, k) * there).softmax(1) @ v
            ),
            "Divide the scores by the root of D.": lambda q, k, v, there: _masked_attention(2 * q, k, v, there),
        },
    ),
    "recall_at": Exercise(
        _recall_at,
        cases=lambda: {
            "all right": (torch.eye(5), 1),
            "random, k = 1": (seeded_randn(12, 12, seed=8), 1),
            "random, k = 3": (seeded_randn(12, 12, seed=8), 3),
            "rows and columns changed, k = 3": (seeded_randn(12, 12, seed=8).T, 3),
        },
        hints=(
            "for one motion, and its row of N numbers: when is it a hit?",
            "row n is motion n, and its own sentence is column n; count how many in the row are nearer than that, and "
            "see whether they are fewer than k; the answer is a share from 0 to 1.",
            "near.topk(k, dim=1).indices == torch.arange(N)[:, None] has a True in the rows that are hits.",
        ),
        mistakes={
            "Motions are rows: sort along dimension 1.": lambda near, k: _recall_at(near.T, k),
            "Among the k nearest: k - 1 others may be nearer, not k.": lambda near, k: _recall_at(near, k + 1),
            "The nearest have the largest similarity, not the least.": lambda near, k: _recall_at(-near, k),
            "A share from 0 to 1, not per cent.": lambda near, k: 100 * _recall_at(near, k),
        },
    ),
}
