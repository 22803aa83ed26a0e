"""The style mixer: sliders for the numbers of a style, and a performer that follows them."""

from __future__ import annotations

import io

import ipywidgets
import numpy as np

from ..actor import SEEN, UNSEEN, Performance, Style, mix, parameters, perform, retell, style_named
from ..errors import MotionKitError
from .pictured import Pictured
from .player import Player
from .plots import Print, few_colours, still
from .style_plots import STYLE_GROUPS, plot_styles

_STRONGEST, _WEAKEST = 2.0, -0.5


class StyleMixer(Pictured, ipywidgets.VBox):
    """A performer over the sliders of their style; see `style_mixer`.

    controls: "style", "intensity", and every parameter in `STYLE_GROUPS`, name to widget. `style` is what they say,
    `performance` what is shown.
    """

    about = "sliders"

    def __init__(self, intention: Performance, start: str) -> None:
        self._intention, self._base, self._quiet = intention, style_named(start), False
        self.controls = _controls(self._base)
        self.performance = retell(intention, self._base)
        self.player = Player(self.performance.motion, height=360)
        rows = [self._row(group, names) for group, names in STYLE_GROUPS.items()]
        back = ipywidgets.Button(
            description="reset", tooltip="All sliders as the style has them", layout={"width": "70px"}
        )
        back.on_click(lambda _: self._begin(self._base))
        head = ipywidgets.HBox([self.controls["style"], self.controls["intensity"], back])
        super().__init__([self.player, head, ipywidgets.HBox(rows, layout={"flex_flow": "row wrap"})])
        self.controls["style"].observe(lambda change: self._begin(style_named(change["new"])), "value")
        for name, control in self.controls.items():
            if name != "style":
                control.observe(self._retell, "value")

    def _row(self, group: str, names: tuple[str, ...]) -> ipywidgets.VBox:
        return ipywidgets.VBox([ipywidgets.HTML(f"<b>{group}</b>"), *(self.controls[name] for name in names)])

    @property
    def style(self) -> Style:
        """The style that the controls say: the one chosen, with what the sliders changed, at the intensity set."""
        changed = {name: self.controls[name].value for group in STYLE_GROUPS.values() for name in group}
        whole = Style("mine", **{**self._base.values(), **changed})
        return mix({whole: self.controls["intensity"].value}, "mine")

    def _begin(self, style: Style) -> None:
        """Put all sliders where a style has them, at full intensity, and perform once."""
        self._quiet, self._base = True, style
        for group in STYLE_GROUPS.values():
            for name in group:
                self.controls[name].value = getattr(style, name)
        self.controls["intensity"].value, self._quiet = 1.0, False
        self._retell()

    def _retell(self, _: object = None) -> None:
        """Perform anew, and go on at the same beat, so that a foot in the air stays in the air."""
        if self._quiet:
            return
        before, frame = self.performance, min(self.player.frame, len(self.performance) - 1)
        self.performance = retell(self._intention, self.style)
        self.player.motions = self.performance.motion
        if len(self.performance) != len(before):
            self.player.frame = round(float(self.performance.frames_at(before.beats[frame : frame + 1])))

    def still(self) -> bytes:
        """The performer beside the numbers of the style, as the bytes of a PNG."""
        picture, raw = Print(figsize=(8.4, 3.8), dpi=100), io.BytesIO()
        frame = self.player.frame or len(self.performance) // 3
        still(self.performance.motion, frame, ax=picture.add_axes((0, 0, 0.46, 1)))
        plot_styles([self.style], ax=picture.add_axes((0.6, 0.08, 0.38, 0.9)))
        picture.savefig(raw, format="png", facecolor="white")
        return few_colours(raw)


def style_mixer(content: str = "walk", style: str = "neutral", seed: int = 1, seconds: float = 6.0) -> StyleMixer:
    """A performer and sliders for the most telling numbers of their style: move one, and they follow at once.

    content, seed, seconds: as for `actor.perform`. style: a name, where the sliders begin. Choosing another style puts
    all sliders there; intensity strengthens or weakens everything. Raises MotionKitError for unknown names.

    >>> mixer = style_mixer("walk", "old")
    >>> mixer.controls["slump"].value, mixer.style.slump
    (0.42, 0.42)
    >>> mixer.controls["slump"].value = 0.0
    >>> mixer.style.slump
    0.0
    """
    if not isinstance(style, str):
        raise MotionKitError(f"style_mixer: style is a name, one of {', '.join((*SEEN, *UNSEEN))}; found {style!r}")
    style_named(style)
    return StyleMixer(perform(content, "neutral", seed, seconds=seconds), style)


def _controls(style: Style) -> dict[str, ipywidgets.Widget]:
    """A dropdown for named styles, the intensity, and a slider for each number."""
    found: dict[str, ipywidgets.Widget] = {
        "style": ipywidgets.Dropdown(
            options=(*SEEN, *UNSEEN), value=style.name, description="begin with", layout={"width": "230px"}
        ),
        "intensity": ipywidgets.FloatSlider(
            value=1.0, min=_WEAKEST, max=_STRONGEST, step=0.05, description="intensity", layout={"width": "290px"}
        ),
    }
    known = parameters()
    for group in STYLE_GROUPS.values():
        for name in group:
            about = known[name]
            step = float(np.power(10.0, np.floor(np.log10((about.high - about.low) / 60))))
            found[name] = ipywidgets.FloatSlider(
                value=getattr(style, name),
                min=about.low,
                max=about.high,
                step=step,
                description=name.replace("_", " "),
                tooltip=f"{about.about} ({about.unit})",
                layout={"width": "290px"},
            )
    return found
