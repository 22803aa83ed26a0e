"""Pictures of style: its named numbers, curves over the gait cycle, errors on the body, speeds by frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import ipywidgets
import numpy as np
import torch
from torch import Tensor

from .. import rotations as rot
from ..actor import Performance, Style, mix, parameters, perform, retell
from ..actor.style import HELD_OUT_STYLES, TRAIN_STYLES, get_style
from ..errors import MotionKitError
from ..metrics import EDGES, speed_bands
from ..motion import Motion
from ..viewer import colours
from ..viewer.figure import StillWidget, draw_figure, figures, view_axes
from ..viewer.player import Player
from ..viewer.plots import INK, SOFT, StaticFigure, still, style_axes
from . import Exercise, seeded_randn

STYLE_GROUPS = {  # the numbers that tell most at a glance
    "timing": ("tempo", "pauses", "asymmetry"),
    "gait": ("step_length", "step_width", "clearance", "bob"),
    "posture": ("crouch", "lean", "slump", "head_pitch"),
    "arms": ("arm_swing", "arm_out", "arm_forward", "elbow_bend"),
}


def plot_styles(
    styles: Sequence[Style], groups: Mapping[str, Sequence[str]] = STYLE_GROUPS, *, ax: object = None
) -> object:
    """Styles as points: a line for each number, over its whole range, and a dot for each style.

    styles: up to eight. groups: heading to parameter names. A grey tick stands where neutral is. Returns the matplotlib
    Figure.

    >>> from motionkit import actor
    >>> picture = plot_styles([actor.get_style("old"), actor.get_style("proud")])
    """
    picture = StaticFigure(figsize=(7.6, 4.6), dpi=110, layout="constrained") if ax is None else ax.figure
    ax = picture.add_subplot() if ax is None else ax
    known, y, marks = parameters(), 0.0, {}
    for group in groups.values():
        for name in group:
            about = known[name]
            marks[y] = name
            place = (about.neutral - about.low) / (about.high - about.low)
            ax.plot([0, 1], [y, y], color="#dfe4eb", lw=3, solid_capstyle="round", zorder=1)
            ax.plot(place, y, "|", color=SOFT, ms=11, mew=2, zorder=2)
            for n, style in enumerate(styles):
                at = (getattr(style, name) - about.low) / (about.high - about.low)
                ink = colours.CYCLE[n % len(colours.CYCLE)]
                dot = {"color": ink, "ms": 8, "mec": "white", "mew": 1, "zorder": 3}
                lift = 0.22 * ((len(styles) - 1) / 2 - n)  # equal numbers would hide each other
                ax.plot(at, y + lift, "o", label=style.name if y == 0 else None, **dot)
            y -= 1
        y -= 0.5
    ax.set_yticks(list(marks), list(marks.values()))
    ax.set_xticks([0, 1], ["lowest", "highest"])
    ax.set(xlim=(-0.03, 1.03), ylim=(y + 0.7, 0.8))
    style_axes(ax, legend=len(styles) > 1)
    ax.grid(visible=False)
    return picture


def gait_angles(performance: Performance) -> dict[str, Tensor]:
    """What a gait is told by, [F] each: bend of left knee and elbow, the trunk's lean (degrees), the head's height (m).

    Raises MotionKitError for a body without these joints.

    >>> from motionkit import actor
    >>> {name: len(values) for name, values in gait_angles(actor.perform("walk", seconds=4)).items()}
    {'left knee (°)': 120, 'left elbow (°)': 120, 'trunk lean (°)': 120, 'head height (m)': 120}
    """
    motion = performance.motion
    places, index = motion.positions(), motion.skeleton.index

    def bend(a: str, b: str, c: str) -> Tensor:
        above, below = places[:, index(b)] - places[:, index(a)], places[:, index(c)] - places[:, index(b)]
        return torch.cosine_similarity(above, below, dim=-1).clamp(-1, 1).acos().rad2deg()

    trunk = places[:, index("neck")] - places[:, index("pelvis")]
    ahead = rot.quaternion_rotate(rot.yaw_to_quaternion(-motion.facing()), trunk)
    return {
        "left knee (°)": bend("left_hip", "left_knee", "left_ankle"),
        "left elbow (°)": bend("left_shoulder", "left_elbow", "left_wrist"),
        "trunk lean (°)": torch.atan2(ahead[:, 2], ahead[:, 1]).rad2deg(),
        "head height (m)": places[:, index("head"), 1],
    }


def cycle_mean(values: Tensor, phase: Tensor, bins: int = 25) -> Tensor:
    """The mean of values [F] in each of `bins` equal parts of the cycle, [bins]; nan where no frame falls.

    phase: [F], 0 to 1.

    >>> cycle_mean(torch.tensor([1.0, 3.0, 5.0]), torch.tensor([0.1, 0.2, 0.9]), bins=2)
    tensor([2., 5.])
    """
    part = (phase * bins).long().clamp(max=bins - 1)
    sums = values.new_zeros(bins).index_add(0, part, values)
    return sums / torch.bincount(part, minlength=bins)


def plot_phase(performances: Mapping[str, Performance], bins: int = 25) -> StaticFigure:
    """Knee, elbow, trunk and head of walks over the gait cycle, from one landing of the left foot to the next.

    performances: name to Performance, up to eight; each curve is the mean of its cycles. Returns the matplotlib Figure.

    >>> from motionkit import actor
    >>> picture = plot_phase({"neutral": actor.perform("walk", seconds=4)})
    """
    picture = StaticFigure(figsize=(9.5, 4.6), dpi=100, layout="constrained")
    panels = list(picture.subplots(2, 2, sharex=True).flat)
    share = (torch.arange(bins) + 0.5) * 100 / bins
    for n, (name, performance) in enumerate(performances.items()):
        phase = performance.phase.float()
        for ax, (what, values) in zip(panels, gait_angles(performance).items()):
            ax.plot(share, cycle_mean(values, phase, bins), color=colours.CYCLE[n % 8], lw=2, label=name)
            ax.set_title(what, fontsize=9.5, loc="left", color=INK)
            style_axes(ax)
    for ax in panels[2:]:
        ax.set_xlabel("% of the cycle (0: the left foot lands)")
    picture.legend(*panels[0].get_legend_handles_labels(), loc="outside right center", frameon=False, labelcolor=INK)
    return picture


def plot_joint_errors(pose: Motion, errors: Mapping[str, Tensor]) -> StaticFigure:
    """Errors on the body: around every joint a disc whose radius is the error, to the body's own scale.

    pose: one frame, the right answer. errors: name to millimetres a joint [J]; a panel for each, with the mean over
    joints in its title. Returns the matplotlib Figure.

    >>> import motionkit as mk
    >>> pose = mk.load("data/actor/walk_old.bvh")[40:41]
    >>> picture = plot_joint_errors(pose, {"a guess": torch.full((22,), 30.0)})
    """
    picture = StaticFigure(figsize=(2.9 * len(errors), 3.4), dpi=100, layout="constrained")
    figure = figures([pose.at_origin()], layout="overlay")[0]
    pale = replace(figure, colours=("#cfd6df",) * len(figure.colours))
    view = view_axes(figure.left)
    joints, size = figure.points[0] @ view.T, figure.size
    for ax, (name, values) in zip(picture.subplots(1, len(errors), squeeze=False)[0], errors.items()):
        if len(values) != len(joints):
            raise MotionKitError(f"plot_joint_errors: {name!r} has {len(values)} errors, the pose {len(joints)} joints")
        draw_figure(ax, pale, figure.points[0], view)
        for place, value in zip(joints, values.tolist()):
            ax.add_patch(_disc(place, value / 1000))
        ax.set_title(f"{name}: {float(values.mean()):.0f} mm", fontsize=10, color=INK)
        ax.set(xlim=(-0.55 * size, 0.55 * size), ylim=(-0.12 * size, 1.15 * size), aspect="equal")
        ax.set_axis_off()
    return picture


def _disc(place: np.ndarray, radius: float) -> object:
    from matplotlib.patches import Circle

    return Circle(place[:2], radius, facecolor=colours.CONTACT, alpha=0.3, lw=0, zorder=9)


def plot_speed_bands(captured: Sequence[Motion], made: Sequence[Motion], joints: Mapping[str, str]) -> StaticFigure:
    """How fast joints move, on average and in bands of frequency: captured clips as bars, made ones as dots.

    joints: name in the captured clips to name in the made ones, a panel each. A bar holds 95 % of the captured clips;
    a dot is the median of those made. Returns the matplotlib Figure.

    >>> from motionkit import actor
    >>> walks = [actor.perform("walk", seed=seed, seconds=4).motion for seed in range(3)]
    >>> picture = plot_speed_bands(walks, walks, {"pelvis": "pelvis", "left_wrist": "left_wrist"})
    """
    theirs = torch.stack([speed_bands(m, list(joints)) for m in captured])
    ours = torch.stack([speed_bands(m, list(joints.values())) for m in made]).median(0).values
    low, high = (torch.quantile(theirs, q, 0) for q in (0.025, 0.975))
    ticks = ["mean", *(f"{a:g}–\n{b:g}" for a, b in zip(EDGES, EDGES[1:]))]
    picture = StaticFigure(figsize=(9.5, 3.0), dpi=100, layout="constrained")
    for n, (ax, name) in enumerate(zip(picture.subplots(1, len(joints), squeeze=False)[0], joints.values())):
        x = range(len(ticks))
        ax.bar(x, high[n] - low[n], 0.55, low[n], color="#cfd6df", label="95 % of captures")
        ax.plot(x, ours[n], "o", color=colours.CYCLE[4], ms=7, mec="white", label="performer")
        ax.set_xticks(x, ticks, fontsize=7)
        ax.set(yscale="log", ylabel="" if n else "speed (m/s)")
        ax.set_title(name, fontsize=9.5, loc="left", color=INK)
        style_axes(ax)
        ax.tick_params(axis="x", labelsize=7)
    picture.legend(*picture.axes[0].get_legend_handles_labels(), loc="outside upper right", ncols=2, frameon=False)
    picture.supxlabel("the mean, then swings by frequency (Hz)", fontsize=9, color=INK)
    return picture


_STRONGEST, _WEAKEST = 2.0, -0.5


class StyleMixer(StillWidget, ipywidgets.VBox):
    """A performer over the sliders of their style; see `style_mixer`.

    controls: "style", "intensity", and every parameter in `STYLE_GROUPS`, name to widget. `style` is what they say,
    `performance` what is shown.
    """

    about = "sliders"

    def __init__(self, intention: Performance, start: str) -> None:
        self._intention, self._base, self._quiet = intention, get_style(start), False
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
        self.controls["style"].observe(lambda change: self._begin(get_style(change["new"])), "value")
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
        picture = StaticFigure(figsize=(8.4, 3.8), dpi=100)
        frame = self.player.frame or len(self.performance) // 3
        still(self.performance.motion, frame, ax=picture.add_axes((0, 0, 0.46, 1)))
        plot_styles([self.style], ax=picture.add_axes((0.6, 0.08, 0.38, 0.9)))
        return picture.png()


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
        raise MotionKitError(
            f"style_mixer: style is a name, one of {', '.join((*TRAIN_STYLES, *HELD_OUT_STYLES))}; found {style!r}"
        )
    get_style(style)
    return StyleMixer(perform(content, "neutral", seed, seconds=seconds), style)


def _controls(style: Style) -> dict[str, ipywidgets.Widget]:
    """A dropdown for named styles, the intensity, and a slider for each number."""
    names, wide = (*TRAIN_STYLES, *HELD_OUT_STYLES), {"layout": {"width": "290px"}}
    controls: dict[str, ipywidgets.Widget] = {
        "style": ipywidgets.Dropdown(
            options=names, value=style.name, description="begin with", layout={"width": "230px"}
        ),
        "intensity": ipywidgets.FloatSlider(
            value=1.0, min=_WEAKEST, max=_STRONGEST, step=0.05, description="intensity", **wide
        ),
    }
    known = parameters()
    for group in STYLE_GROUPS.values():
        for name in group:
            about = known[name]
            step = float(np.power(10.0, np.floor(np.log10((about.high - about.low) / 60))))
            text = {"description": name.replace("_", " "), "tooltip": f"{about.about} ({about.unit})"}
            span = {"min": about.low, "max": about.high, "step": step}
            controls[name] = ipywidgets.FloatSlider(value=getattr(style, name), **span, **text, **wide)
    return controls


def _takes() -> dict[str, tuple]:
    shuffled = ["e", "b", "a", "e", "c", "b", "d", "a", "f", "e"]
    return {
        "several clips of a take, apart": (shuffled,),
        "a clip of each take": ([f"take {n}" for n in range(12)],),
        "one take only": (["only"] * 4,),
    }


def _take_split(takes: list[str]) -> Tensor:
    """Which clips are for the test, bool [N]: all those of every fifth take, in alphabetical order."""
    return _among(takes, sorted(set(takes))[::5])


def _among(takes: list[str], chosen: list[str]) -> Tensor:
    return torch.tensor([take in chosen for take in takes])


def _padded() -> dict[str, tuple]:
    """Features [B, F, D] and masks [B, F]."""
    features, mask = seeded_randn(4, 10, 3), torch.arange(10) < torch.tensor([10, 7, 3, 1])[:, None]
    return {
        "nothing padded": (features, torch.ones(4, 10, dtype=torch.bool)),
        "clips of several lengths": (features, mask),
        "large numbers in the padding": (features + 1e3 * ~mask[..., None], mask),
    }


def _masked_mean(features: Tensor, mask: Tensor) -> Tensor:
    """The mean over each clip's own frames, [B, D], of features [B, F, D] with a mask [B, F]."""
    return (features * mask[..., None]).sum(1) / mask.sum(1, keepdim=True)


def _balanced_chances(labels: Tensor) -> Tensor:
    """For each sample the chance to be drawn, [N], such that every label that occurs is drawn equally often."""
    return 1 / (_group_sizes(labels) * len(labels.unique()))


def _group_sizes(labels: Tensor) -> Tensor:
    """For each sample how many have its label, [N]."""
    return torch.bincount(labels)[labels]


EXERCISES = {
    "balanced_chances": Exercise(
        _balanced_chances,
        cases=lambda: {
            "three of one, one of another": (torch.tensor([0, 0, 0, 1]),),
            "labels with gaps": (torch.tensor([2, 5, 5, 2, 2, 9]),),
            "one sample": (torch.tensor([3]),),
        },
        hints=(
            "two labels, three samples of one and one of the other: what must the four chances be?",
            "every label that occurs gets the same share, and its samples divide that among them; all add up to 1, and "
            "labels need not be 0, 1, 2.",
            "torch.unique(labels, return_inverse=True, return_counts=True) tells how large each sample's group is.",
        ),
        mistakes={
            "With equal chances for all samples, frequent labels are drawn most.": lambda x: torch.full(
                x.shape, 1 / len(x)
            ),
            "All chances must add up to 1: divide by how many labels occur.": lambda x: 1 / _group_sizes(x),
            "Labels that do not occur get no share.": lambda x: 1 / (_group_sizes(x) * len(torch.bincount(x))),
            "One over the size of the group, not the size.": lambda x: _group_sizes(x) / _group_sizes(x).sum(),
        },
    ),
    "masked_mean": Exercise(
        _masked_mean,
        cases=_padded,
        hints=(
            "what is the mean of a clip of 3 frames that was padded to 10?",
            "padded frames must count neither in the sum nor in what you divide by.",
            "sum features where mask[..., None] is true, then divide by mask.sum(1)[:, None].",
        ),
        mistakes={
            "The padding is in your mean: the mask was not used.": lambda x, mask: x.mean(1),
            "Divide by the clip's own frames, not by all.": lambda x, mask: (x * mask[..., None]).mean(1),
            "A mean for each clip, not one for all together.": lambda x, mask: x[mask].mean(0).expand(len(x), -1),
        },
    ),
    "take_split": Exercise(
        _take_split,
        cases=_takes,
        hints=(
            "what may never be on both sides of a split?",
            "deal out takes, not clips: every fifth of the different takes in alphabetical order, from the first on; "
            "then a clip goes where its take goes.",
            "sorted(set(takes))[::5] are the takes of the test; torch.tensor([...]) of True and False for the clips.",
        ),
        mistakes={
            "That deals out clips, and tears takes apart.": lambda takes: torch.arange(len(takes)) % 5 == 0,
            "In alphabetical order, not in the order of the list.": lambda x: _among(x, list(dict.fromkeys(x))[::5]),
            "Count each take once: here large takes have a greater chance.": lambda x: _among(x, sorted(x)[::5]),
        },
    ),
}
