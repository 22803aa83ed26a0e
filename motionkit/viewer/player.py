"""`Player`: motions as living 3D figures in a notebook cell, or on a page of their own."""

from __future__ import annotations

import base64
import html
import json
import os
import uuid
from collections.abc import Sequence
from pathlib import Path

import anywidget
import traitlets

from ..errors import MotionKitError
from ..files import write_atomic
from .figure import HiddenStill, as_list, contact_marks, encode_scene, figures, label_texts, per_motion

_JS = Path(__file__).parent / "js"
_PARTS = ("stage.js", "camera.js", "shaders.js", "gl.js", "flat.js", "view.js")


def script(*last: str) -> str:
    """A 3D view's JavaScript as one module; `last` are the files that put it to use: player.js and widget.js."""
    return "\n".join((_JS / name).read_text(encoding="utf-8") for name in (*_PARTS, *last))


def prepare(
    motions: object,
    *,
    labels: Sequence[str] | None = None,
    roles: Sequence[str] | None = None,
    layout: str = "side",
    trails: Sequence[str] = (),
    contacts: object = None,
) -> bytes:
    """Motions and what to show with them as the bytes that the browser reads; see `Player` for the arguments."""
    shown = as_list(motions)
    placed = figures(shown, roles=roles, layout=layout)
    texts = label_texts(shown, labels, roles)
    trails = (trails,) if isinstance(trails, str) else tuple(trails)
    for name in trails:
        if not any(name in f.names for f in placed):
            raise MotionKitError(f"trails: no joint {name!r}; joints: {', '.join(placed[0].names)}")
    if contacts is None or isinstance(contacts, bool):
        contacts = [contacts] * len(placed)
    contacts_of_each = per_motion(contacts if isinstance(contacts, list) else [contacts], len(placed), "contacts")
    marks = [contact_marks(f, _feet(m, c)) for m, f, c in zip(shown, placed, contacts_of_each)]
    return encode_scene(placed, labels=texts, trails=trails, contacts=marks)


def _feet(motion: object, contacts: object) -> object:
    """Contacts by name where they were asked for (True) or given as the tensor of `contacts.foot_contacts`."""
    from ..contacts import feet_of, foot_contacts

    if contacts is None or contacts is False:
        return None
    if contacts is True:
        return feet_of(motion), foot_contacts(motion)
    alone = hasattr(contacts, "shape") and len(contacts.shape) == 2 and contacts.shape[1] != len(motion.skeleton.names)
    return (feet_of(motion), contacts) if alone else contacts


class Player(HiddenStill, anywidget.AnyWidget):
    """A live 3D player for one motion or several.

    motions: a Motion or a list of them; different lengths, frame rates and skeletons play together by time.
    labels: a text over each; with several motions the role or name by default. roles: for each "content", "style",
    "result", a colour `#rrggbb` or None (limbs coloured by side). layout: "side", "treadmill" (side by side, and nobody
    leaves the spot) or "overlay" (each at its own place). trails: joints that draw their path. contacts: True to find
    the feet's; else for each motion what `contacts.foot_contacts` gives, or (joint names, bool tensor [F, K]), or a
    dict from joint name to bool [F]; in a list where there are several motions. height: pixels. autoplay: start by
    itself when seen.

    `frame` (counted in the first motion's frames), `playing`, `speed` and `loop` are traits: set them and the picture
    follows; while it plays, `frame` is reported at most about eight times a second. `player.motions = ...` or
    `set_motions` replaces what is shown and keeps time and camera.

    >>> import torch
    >>> from types import SimpleNamespace as N
    >>> class Clip(N):
    ...     __len__ = lambda self: 3
    ...     positions = lambda self: torch.zeros(3, 1, 3)
    >>> clip = Clip(fps=30.0, name="dot", skeleton=N(names=("dot",), parents=(-1,), sides=("middle",)))
    >>> player = Player(clip, autoplay=False)
    >>> player.frame = 2
    >>> player
    Player(dot: 3 frames, 1 joint)
    """

    _esm = script("player.js", "widget.js")
    _css = (_JS / "player.css").read_text(encoding="utf-8")
    _view = "mk-player"
    _data = traitlets.Bytes().tag(sync=True)
    _still = traitlets.Unicode().tag(sync=True)
    height = traitlets.Int(420).tag(sync=True)
    frame = traitlets.Int(0).tag(sync=True)
    playing = traitlets.Bool(False).tag(sync=True)
    speed = traitlets.Float(1.0).tag(sync=True)
    loop = traitlets.Bool(True).tag(sync=True)

    def __init__(
        self,
        motions: object,
        *,
        labels: Sequence[str] | None = None,
        roles: Sequence[str] | None = None,
        layout: str = "side",
        trails: Sequence[str] = (),
        contacts: object = None,
        height: int = 420,
        loop: bool = True,
        speed: float = 1.0,
        autoplay: bool = True,
    ) -> None:
        self._shown = {"labels": labels, "roles": roles, "layout": layout, "trails": trails, "contacts": contacts}
        self._motions = as_list(motions)
        super().__init__(
            _data=prepare(self._motions, **self._shown),
            _still=f"mk-still-{uuid.uuid4()}",
            height=height,
            loop=loop,
            speed=speed,
            playing=autoplay,
        )

    @traitlets.validate("speed")
    def _check_speed(self, proposal: dict) -> float:
        if not 0 < proposal["value"] <= 100:
            raise MotionKitError(f"speed: expected a number above 0 and up to 100, found {proposal['value']}")
        return proposal["value"]

    @traitlets.validate("frame")
    def _check_frame(self, proposal: dict) -> int:
        return min(max(proposal["value"], 0), self.frame_count - 1)

    @property
    def frame_count(self) -> int:
        """How many values `frame` has: the longest motion's duration in frames of the first."""
        end = max((len(m) - 1) / m.fps for m in self._motions)
        return round(end * self._motions[0].fps) + 1

    @property
    def motions(self) -> list:
        """The motions shown, as a list."""
        return list(self._motions)

    @motions.setter
    def motions(self, motions: object) -> None:
        self.set_motions(motions)

    def set_motions(self, motions: object, **changes: object) -> None:
        """Shows other motions at once; time and camera stay. changes: labels, roles, layout, trails or contacts.

        Contacts belong to the motions they were given with, so they go unless new ones are given; labels and roles stay
        as long as the number of motions does.
        """
        wrong = sorted(set(changes) - set(self._shown))
        if wrong:
            raise MotionKitError(f"set_motions: unknown {', '.join(wrong)}; known: {', '.join(self._shown)}")
        replacing = as_list(motions)
        looks = {**self._shown, "contacts": None}
        if len(replacing) != len(self._motions):
            looks.update(labels=None, roles=None)
        shown = {**looks, **changes}
        data = prepare(replacing, **shown)
        self._motions, self._shown = replacing, shown
        self._data = data
        self.frame = min(self.frame, self.frame_count - 1)

    def still(self, frame: int | None = None) -> bytes:
        """A still picture of the player, as PNG: of the frame shown, or of a later one where that is the first."""
        from .plots import still_png

        shown = self.frame if frame is None else frame
        if frame is None and shown == 0:
            shown = self.frame_count // 3
        named = {k: self._shown[k] for k in ("labels", "roles", "layout")}
        return still_png(self._motions, shown, pixels=(760, max(200, min(self.height, 380))), **named)

    def save_html(self, path: str | os.PathLike) -> Path:
        """Writes a page that plays the same motions in any browser, without a network; returns its path."""
        values = {"height": self.height, "speed": self.speed, "loop": self.loop}
        return _write_page(self._data, path, ", ".join(m.name for m in self._motions), values)

    def __repr__(self) -> str:
        sizes = [
            f"{m.name}: {_count(len(m), 'frame')}, {_count(len(m.skeleton.names), 'joint')}" for m in self._motions
        ]
        return f"Player({'; '.join(sizes)})"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def save_html(
    motions: object, path: str | os.PathLike, *, speed: float = 1.0, loop: bool = True, **shown: object
) -> Path:
    """Writes a page that plays motions in any browser, from file:// and without a network; returns its path.

    shown: labels, roles, layout, trails and contacts as for `Player`. The page is written beside its place and then put
    there, so that a page that is there is never half of one.
    """
    data = prepare(motions, **shown)
    title = ", ".join(m.name for m in as_list(motions))
    return _write_page(data, path, title, {"fill": True, "height": 420, "speed": speed, "loop": loop})


def _write_page(data: bytes, path: str | os.PathLike, title: str, values: dict) -> Path:
    page = (_JS / "page.html").read_text(encoding="utf-8")
    filled = {
        "title": html.escape(title),
        "css": (_JS / "player.css").read_text(encoding="utf-8"),
        "script": script("player.js", "page.js"),
        "values": json.dumps({"frame": 0, "playing": True, **values}),
        "data": base64.b64encode(data).decode(),
    }
    for name, text in filled.items():
        page = page.replace(f"<!--{name}-->", text, 1)
    return write_atomic(path, page)
