"""Style-ERD live: one frame in, one frame out, of many streams at once (paper 2, section 4.3)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from ..errors import MotionKitError
from ..features.style_erd import SETTLE, TENTH
from ..motion import Motion
from .base import without_helper_joints
from .style_erd_labels import LabelTracker
from .style_erd_numpy import rotate_quaternion_y, rotate_y

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
        model,
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
        self.model, self.count, self.fade = model, count, fade
        self._guesses = LabelTracker(model.labeller) if model.labeller is not None else None
        self.content, self.own_style = content, own_style
        self._ask(style, strength)
        self._state, self._before, self._path, self._stages = None, None, None, None
        self._one_hot = np.eye(len(model.styles), dtype=np.float32)
        self.held, self._last_good = np.zeros(count, int), None

    @property
    def style(self) -> object:
        """What is wanted, as it was given."""
        return self._style

    @style.setter
    def style(self, style: object) -> None:
        self._ask(style, self._strength)

    @property
    def strength(self) -> object:
        """How much of the style: 0 is neutral, 1 all of it."""
        return self._strength

    @strength.setter
    def strength(self, strength: object) -> None:
        self._ask(self._style, strength)

    def _ask(self, style: object, strength: object) -> None:
        """Both at once, or neither where one of them is wrong."""
        pairs = zip(self._each(style), self._each(strength), strict=True)
        self._wanted = np.stack([self.model.style_weights(*pair) for pair in pairs])
        self._style, self._strength = style, strength

    @property
    def content(self) -> object:
        """The label of what comes in, as it was given."""
        return self._content

    @content.setter
    def content(self, content: object) -> None:
        self._contents, self._content = self._label_ids("content", content), content

    @property
    def own_style(self) -> object:
        """The style of what comes in, as it was given."""
        return self._own

    @own_style.setter
    def own_style(self, style: object) -> None:
        self._owns, self._own = self._label_ids("style", style), style

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
        parts = zip(*((body.rotations, body.translations) for body in bodies))
        rotations, root = self.push(*(torch.cat(part).numpy() for part in parts))
        results = []
        for n, (motion, body) in enumerate(zip(several, bodies)):
            translations = body.translations.clone()
            translations[0, 0] = torch.from_numpy(root[n])
            styled = body.replace(rotations=torch.from_numpy(rotations[n : n + 1]), translations=translations)
            results.append(motion.with_helper_joints_of(styled))
        return results[0] if isinstance(frames, Motion) else results

    def push(self, rotations: np.ndarray, translations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same in numbers: local quaternions [B, J, 4] and translations [B, J, 3], the root's in the world.

        Returns quaternions [B, J, 4] and the root's places [B, 3].
        """
        rotations, translations = self._good(np.float32(rotations), np.float32(translations))
        body, count = self.model.body, self.count
        places = body.places(rotations, translations)
        yaw, ground = body.facing(places), places[:, 0] * np.float32([1, 0, 1])
        gap = (self._gap / self.model.fps * TENTH)[:, None, None]
        moved = np.zeros_like(places) if self._before is None else (places - self._before) / gap
        turned = rotate_y(-yaw, np.concatenate((places - ground[:, None], moved), 1))
        positions, velocities = turned[:, : places.shape[1]], turned[:, places.shape[1] :]
        local = rotations.copy()
        local[:, 0] = rotate_quaternion_y(-yaw, rotations[:, 0])
        local *= np.where(local[..., :1] < 0, np.float32(-1), np.float32(1))
        x = np.concatenate([p.reshape(count, -1) for p in (local, positions, velocities)], 1, dtype=np.float32)
        self._guess(x)
        if self._state is None:
            self._state, self._path = self.model.step.initial_states(self._contents), ground
        wanted, own = self._followed(np.stack((self._wanted, self._one_hot[self._owns])))
        y, self._state = self.model.step.step(x, self._contents, self._owns, wanted, self._state, own)
        placed = self._placed(y, translations, yaw, body.lowest(positions))
        self._before = places
        return placed

    def _placed(self, y: np.ndarray, translations: np.ndarray, yaw: np.ndarray, low: np.ndarray) -> tuple:
        """The network's output [B, 7J] in the world, as `features.style_erd.motion_from`: rotations and root."""
        joints, body = translations.shape[1], self.model.body
        rotations = y[:, : 4 * joints].reshape(self.count, joints, 4)
        rotations = rotations / np.sqrt((rotations * rotations).sum(-1, keepdims=True))
        offsets = translations.copy()
        offsets[:, 0] = 0
        height = low - body.lowest_of(rotations, offsets)
        if self._before is not None:
            step = rotate_y(yaw, y[:, None, 4 * joints : 4 * joints + 3] * np.float32(TENTH / self.model.fps))[:, 0]
            self._path = self._path + step
            height = self._path[:, 1] + np.float32(SETTLE) * (height - self._path[:, 1])
        self._path[:, 1] = height
        rotations[:, 0] = rotate_quaternion_y(yaw, rotations[:, 0])
        return rotations.astype(np.float32), self._path.astype(np.float32)

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
            self._guesses.update(x)
            self._contents = self._guesses.content if missing[0] else self._contents
            self._owns = self._guesses.style if missing[1] else self._owns

    def _label_ids(self, what: str, labels: object) -> np.ndarray:
        """Of a content or a style of each stream; 0 until they are guessed, where they are to be."""
        if labels is not None:
            return np.array([self.model.label_id(what, one) for one in self._each(labels)])
        if self._guesses is None:
            known = self.model.contents if what == "content" else self.model.styles
            raise MotionKitError(f"this model guesses no labels; say the {what} of what comes in: {', '.join(known)}")
        return np.zeros(self.count, int)

    def _good(self, rotations: np.ndarray, translations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Frames that are not finite replaced by the last good ones; how many frames lie between counts for speeds."""
        fine = np.isfinite(rotations).all((1, 2)) & np.isfinite(translations).all((1, 2))
        self._gap = np.where(fine, self.held + 1, 1).astype(np.float32)
        if not fine.all():
            if self._last_good is None:
                raise MotionKitError("a stream's first frame holds numbers that are not finite; begin with a whole one")
            pairs = zip((rotations, translations), self._last_good)
            rotations, translations = (np.where(fine[:, None, None], now, last) for now, last in pairs)
        self.held = np.where(fine, 0, self.held + 1)
        self._last_good = rotations, translations
        return rotations, translations

    def _each(self, value: object) -> list:
        """One for each stream."""
        values = list(value) if isinstance(value, list | tuple | np.ndarray) else [value] * self.count
        if len(values) != self.count:
            mix = "; a mix of styles is such as {'old': 0.5, 'proud': 0.5}" if self.count == 1 else ""
            raise MotionKitError(f"expected one for each of {self.count} streams; found {value!r:.60}{mix}")
        return values

    def _checked(self, frame: Motion) -> Motion:
        if not isinstance(frame, Motion) or len(frame) != 1:
            raise MotionKitError(f"a stream takes one frame at a time, such as motion[n : n + 1]; found {frame!r:.60}")
        body, model = without_helper_joints(frame), self.model
        if body.skeleton.names != model.skeleton.names or body.skeleton.parents != model.skeleton.parents:
            odd = next((a for a, b in zip(body.skeleton.names, model.skeleton.names) if a != b), "another tree")
            raise MotionKitError(
                f"the stream's frames stand on another skeleton than the model's, or on its joints in another order "
                f"(first at {odd!r}); bring them on it first, method.onto_model(motion)"
            )
        if abs(frame.fps - model.fps) > 1e-3:
            raise MotionKitError(f"this model takes {model.fps:g} frames a second; found {frame.fps:g}: resample first")
        return body
