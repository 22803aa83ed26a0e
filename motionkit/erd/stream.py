"""Live: one frame in, one frame out, while style, strength and mix are changed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from ..errors import MotionKitError
from ..motion import Motion
from ..restyling import body_of
from .frames import SETTLE, TENTH
from .labels import Guesses
from .model import ErdModel
from .quick_body import turned, yawed

_STAGES = 4  # low-passes between a wish and what is done


class ErdStream:
    """B streams through a model at once (paper 2, section 4.3): call it with one frame of each, each has its own state.

    model: trained. style: a name, or a mix; strength: how much of it; both may be set at any frame: `stream.style =
    "old"`, or a list with one for each stream. From the next frame on the style follows the wish, and is there after
    about `fade` seconds, since a pose that changes from one frame to the next is a jump; 0: at once. content,
    own_style: labels of what comes in, which may change too; None where they are to be guessed, see `labels`. count: B.

    `held`: how many frames in a row were not finite numbers, for each stream; then the last good one was taken again.
    `extrapolated`: whether more than all or less than nothing of a style is asked for.
    """

    def __init__(
        self,
        model: ErdModel,
        style: object = "neutral",
        strength: object = 1.0,
        *,
        content: object = None,
        own_style: object = None,
        count: int = 1,
        fade: float = 1.0,
    ) -> None:
        if isinstance(count, bool) or not isinstance(count, int) or count < 1:
            raise MotionKitError(f"count says how many streams run side by side, from 1; found {count!r}")
        if isinstance(fade, bool) or not isinstance(fade, int | float) or not 0 <= fade < float("inf"):
            raise MotionKitError(f"fade is how many seconds a style takes to come, from 0; found {fade!r}")
        self.model, self.count, self.fade, self._strength, self._style = model, count, fade, 1.0, None
        self._state, self._before, self._path, self._stages = None, None, None, None
        self._whole = np.eye(len(model.styles), dtype=np.float32)
        self._guesses = Guesses(model.labeller) if model.labeller is not None else None
        self.content, self.own_style = content, own_style
        self._strength = strength
        self.style = style
        self.held, self._like = np.zeros(count, int), None

    @property
    def style(self) -> object:
        """What is wanted, as it was given."""
        return self._style

    @style.setter
    def style(self, style: object) -> None:
        pairs = zip(self._each(style), self._each(self._strength), strict=True)
        self._wanted = np.stack([self.model.wanted(*pair) for pair in pairs])
        self._style = style

    @property
    def strength(self) -> object:
        """How much of the style: 0 is neutral, 1 all of it."""
        return self._strength

    @strength.setter
    def strength(self, strength: object) -> None:
        before, self._strength = self._strength, strength
        try:
            self.style = self._style
        except MotionKitError:
            self._strength = before
            raise

    @property
    def content(self) -> object:
        """The label of what comes in, as it was given."""
        return self._content

    @content.setter
    def content(self, content: object) -> None:
        self._contents, self._content = self._numbers("content", content), content

    @property
    def own_style(self) -> object:
        """The style of what comes in, as it was given."""
        return self._own

    @own_style.setter
    def own_style(self, style: object) -> None:
        self._owns, self._own = self._numbers("style", style), style

    @property
    def labels(self) -> list[tuple[str, str]]:
        """Content and own style of every stream, by which the last frame was restyled: as given, or as guessed."""
        return [(self.model.contents[c], self.model.styles[s]) for c, s in zip(self._contents, self._owns)]

    @property
    def extrapolated(self) -> bool:
        """Whether a style is asked for beyond what was learned from."""
        others = self._wanted[:, 1:]
        return bool((others < 0).any() or (others.sum(1) > 1 + 1e-6).any())

    def __call__(self, frames: Motion | Sequence[Motion]) -> Motion | list[Motion]:
        """The next frame of every stream, each a Motion of one frame; as many come back.

        Raises MotionKitError where skeleton, joints or frame rate are not the model's, or change midway.
        """
        several = list(frames) if isinstance(frames, list | tuple) else [frames]
        bodies = [self._checked(one) for one in several]
        if len(several) != self.count:
            raise MotionKitError(f"this stream takes {self.count} frames at a time; found {len(several)}")
        turns, moves = (torch.cat(part).numpy() for part in zip(*((b.rotations, b.translations) for b in bodies)))
        turns, root = self.push(turns, moves)
        made = []
        for n, (motion, body) in enumerate(zip(several, bodies)):
            translations = body.translations.clone()
            translations[0, 0] = torch.from_numpy(root[n])
            rotations = torch.from_numpy(turns[n : n + 1])
            made.append(motion.with_body(body.replace(rotations=rotations, translations=translations)))
        return made[0] if isinstance(frames, Motion) else made

    def push(self, turns: np.ndarray, translations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same in numbers: local quaternions [B, J, 4] and translations [B, J, 3], the root's in the world.

        Returns quaternions [B, J, 4] and the root's places [B, 3].
        """
        turns, translations = self._good(np.float32(turns), np.float32(translations))
        body, count = self.model.body, self.count
        places = body.places(turns, translations)
        yaw, ground = body.facing(places), places[:, 0] * np.float32([1, 0, 1])
        gap = (self._gap / self.model.fps * TENTH)[:, None, None]
        moved = np.zeros_like(places) if self._before is None else (places - self._before) / gap
        seen = turned(-yaw, np.concatenate((places - ground[:, None], moved), 1))
        local, speed = seen[:, : places.shape[1]], seen[:, places.shape[1] :]
        own = turns.copy()
        own[:, 0] = yawed(-yaw, turns[:, 0])
        own *= np.where(own[..., :1] < 0, np.float32(-1), np.float32(1))
        x = np.concatenate([part.reshape(count, -1) for part in (own, local, speed)], 1, dtype=np.float32)
        self._guess(x)
        if self._state is None:
            self._state, self._path = self.model.fast.begin(self._contents), ground
        wanted, own = self._followed(np.stack((self._wanted, self._whole[self._owns])))
        y, self._state = self.model.fast.step(x, self._contents, self._owns, wanted, self._state, own)
        made, root = self._placed(y, translations, yaw, body.lowest(local))
        self._before = places
        return made, root

    def _placed(self, y: np.ndarray, translations: np.ndarray, yaw: np.ndarray, low: np.ndarray) -> tuple:
        """The network's answer [B, 7J] in the world: quaternions and the root's places."""
        joints, body = translations.shape[1], self.model.body
        made = y[:, : 4 * joints].reshape(self.count, joints, 4)
        made = made / np.sqrt((made * made).sum(-1, keepdims=True))
        lying = translations.copy()
        lying[:, 0] = 0
        height = low - body.lowest_of(made, lying)
        if self._before is not None:
            step = turned(yaw, y[:, None, 4 * joints : 4 * joints + 3] * np.float32(TENTH / self.model.fps))[:, 0]
            self._path = self._path + step
            height = self._path[:, 1] + np.float32(SETTLE) * (height - self._path[:, 1])
        self._path[:, 1] = height
        root = self._path.copy()
        made[:, 0] = yawed(yaw, made[:, 0])
        return made.astype(np.float32), root.astype(np.float32)

    def _followed(self, shares: np.ndarray) -> np.ndarray:
        """Shares of styles for this frame, [2, B, S]: those wanted and those that come in, through low-passes in a row.

        So they set out and arrive gently, also where a wish changes with every frame, as a dial does, or a guess does.
        """
        if self._stages is None or not self.fade:
            self._stages = [shares] * _STAGES
            return shares
        share = np.float32(-np.expm1(-2 * _STAGES / (self.fade * self.model.fps)))
        for n, stage in enumerate(self._stages):
            self._stages[n] = shares = stage + share * (shares - stage)
        return shares

    def _guess(self, x: np.ndarray) -> None:
        """Labels that nobody has said."""
        missing = [self._content is None, self._own is None]
        if any(missing):
            self._guesses.hear(x)
            self._contents = self._guesses.content if missing[0] else self._contents
            self._owns = self._guesses.style if missing[1] else self._owns

    def _numbers(self, what: str, labels: object) -> np.ndarray:
        """Of a content or a style of each stream; 0 until they are guessed, where they are to be."""
        if labels is not None:
            return np.array([self.model.number(what, one) for one in self._each(labels)])
        if self._guesses is None:
            known = self.model.contents if what == "content" else self.model.styles
            raise MotionKitError(f"this model guesses no labels; say the {what} of what comes in: {', '.join(known)}")
        return np.zeros(self.count, int)

    def _good(self, turns: np.ndarray, translations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Frames that are not finite replaced by the last good ones; how many frames lie between counts for speeds."""
        fine = np.isfinite(turns).all((1, 2)) & np.isfinite(translations).all((1, 2))
        self._gap = np.where(fine, self.held + 1, 1).astype(np.float32)
        if not fine.all():
            if self._like is None:
                raise MotionKitError("a stream's first frame holds numbers that are not finite; begin with a whole one")
            pick = fine[:, None, None]
            turns, translations = np.where(pick, turns, self._like[0]), np.where(pick, translations, self._like[1])
        self.held = np.where(fine, 0, self.held + 1)
        self._like = turns, translations
        return turns, translations

    def _each(self, value: object) -> list:
        """One for each stream."""
        found = list(value) if isinstance(value, list | tuple | np.ndarray) else [value] * self.count
        if len(found) != self.count:
            mix = "; a mix of styles is such as {'old': 0.5, 'proud': 0.5}" if self.count == 1 else ""
            raise MotionKitError(f"expected one for each of {self.count} streams; found {value!r:.60}{mix}")
        return found

    def _checked(self, frame: Motion) -> Motion:
        if not isinstance(frame, Motion) or len(frame) != 1:
            raise MotionKitError(f"a stream takes one frame at a time, such as motion[n : n + 1]; found {frame!r:.60}")
        body, model = body_of(frame), self.model
        if body.skeleton.names != model.skeleton.names or body.skeleton.parents != model.skeleton.parents:
            odd = next((a for a, b in zip(body.skeleton.names, model.skeleton.names) if a != b), "another tree")
            raise MotionKitError(
                f"the stream's frames stand on another skeleton than the model's, or on its joints in another order "
                f"(first at {odd!r}); bring them on it first, method.seen(motion)"
            )
        if abs(frame.fps - model.fps) > 1e-3:
            raise MotionKitError(f"this model takes {model.fps:g} frames a second; found {frame.fps:g}: resample first")
        return body
