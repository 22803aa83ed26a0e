"""A style is a point in a space of named physical parameters: how fast, how long the steps, how bent the back, ...

Because the parameters are numbers with a meaning, styles can be mixed, weakened, exaggerated and invented.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace

from ..errors import MotionKitError, check


def _number(neutral: float, low: float, high: float, unit: str, about: str) -> float:
    return field(default=neutral, metadata={"low": low, "high": high, "unit": unit, "about": about})


@dataclass(frozen=True)
class Style:
    """How somebody moves. The defaults are neutral; `parameters()` lists range, unit and meaning of each number.

    Angles in radians, lengths in leg lengths, times in beats (a beat is a step of the walk), "x" for factors.
    Raises MotionKitError for a number that is not finite or out of its range.

    >>> Style("hurried", tempo=1.3, lean=0.15).tempo
    1.3
    """

    name: str = "neutral"
    tempo: float = _number(1.0, 0.35, 1.9, "x", "pace of everything: steps, gestures, breath")
    pauses: float = _number(0.0, 0.0, 0.9, "share", "how far the movement slows down once in every beat")
    asymmetry: float = _number(0.0, -0.5, 0.5, "share", "a limp: left steps shorter and quicker than right ones")
    variability: float = _number(1.0, 0.0, 5.0, "x", "how much each step and gesture differs from the last")
    sharpness: float = _number(0.4, 0.0, 1.0, "share", "0: movements flow; 1: they snap from one pose to the next")
    follow_through: float = _number(0.18, 0.0, 0.6, "beats", "how late hands and head come after the trunk")
    step_length: float = _number(1.0, 0.2, 1.6, "x", "length of a step")
    step_width: float = _number(0.13, 0.0, 0.6, "legs", "from the left foot's track to the right one's")
    clearance: float = _number(0.1067, 0.0, 0.45, "legs", "how high a swinging foot is lifted")
    foot_roll: float = _number(0.9076, 0.0, 1.1, "rad", "pitch of the foot as its toes leave the ground")
    heel_strike: float = _number(0.2572, 0.0, 0.5, "rad", "pitch of the foot as it lands on the heel")
    toe_out: float = _number(0.12, -0.5, 0.8, "rad", "feet turned outwards")
    knee_out: float = _number(0.08, -0.3, 0.9, "share", "knees pointing outwards")
    crouch: float = _number(0.0237, 0.0, 0.35, "legs", "how far the pelvis sinks into bent knees")
    bob: float = _number(1.0, 0.0, 4.0, "x", "rise and fall of the pelvis in every step")
    sway: float = _number(1.0, 0.0, 5.0, "x", "the pelvis moving over the standing foot")
    hip_list: float = _number(0.02, 0.0, 0.35, "rad", "the pelvis dropping towards the swinging leg")
    hip_turn: float = _number(0.0863, 0.0, 0.45, "rad", "the pelvis turning with the legs")
    shoulder_turn: float = _number(0.0214, 0.0, 0.6, "rad", "the shoulders turning against the pelvis")
    side_bend: float = _number(0.0, 0.0, 0.4, "rad", "the trunk rocking from side to side with the steps")
    pelvis_tilt: float = _number(0.08, -0.4, 0.5, "rad", "the pelvis tipping forwards")
    lean: float = _number(0.03, -0.3, 0.9, "rad", "the trunk leaning forwards")
    slump: float = _number(0.05, -0.4, 0.9, "rad", "upper back and shoulders rounded (below 0: chest out)")
    shoulder_lift: float = _number(0.0, -0.2, 0.45, "rad", "shoulders pulled up")
    head_pitch: float = _number(0.04, -0.5, 0.9, "rad", "looking down")
    head_tilt: float = _number(0.0, -0.5, 0.5, "rad", "the head to one side")
    look: float = _number(0.08, 0.0, 0.9, "rad", "how far the head turns about")
    arm_swing: float = _number(0.2932, 0.0, 1.2, "rad", "the arms' swing to either side of where they hang")
    arm_out: float = _number(0.13, -0.05, 1.3, "rad", "arms held away from the body")
    arm_forward: float = _number(0.02, -0.5, 1.6, "rad", "where the arms hang, in front of the body")
    arm_turn: float = _number(0.25, -1.2, 1.2, "rad", "upper arms turned inwards")
    elbow_bend: float = _number(0.3, 0.02, 2.0, "rad", "bend of the elbows")
    elbow_swing: float = _number(0.2135, 0.0, 1.0, "rad", "more bend as the arm comes forwards")
    hand_bend: float = _number(0.1, -1.0, 1.2, "rad", "hands bent in at the wrists")
    reach: float = _number(1.0, 0.3, 1.3, "x", "how far gestures go: raised hands, kicks, jumps, bows")
    wander: float = _number(0.0, 0.0, 1.5, "share", "losing the balance: the trunk drifts, the way bends")
    tremor: float = _number(0.0, 0.0, 0.12, "rad", "hands and head trembling")

    def __post_init__(self) -> None:
        for name, about in parameters().items():
            value = getattr(self, name)
            if not isinstance(value, int | float) or not math.isfinite(value):
                raise MotionKitError(
                    f"style {self.name!r}: {name} must be a finite number ({about.about}); found {value!r}"
                )
            if not about.low <= value <= about.high:
                raise MotionKitError(
                    f"style {self.name!r}: {name} is {value:g} {about.unit}; expected {about.low:g} to {about.high:g} "
                    f"({about.about})"
                )

    def replace(self, **changes: float) -> Style:
        """The same style with some numbers changed; MotionKitError for an unknown one names the nearest.

        >>> Style().replace(lean=0.2).lean
        0.2
        """
        for name in changes:
            if name != "name":
                check.one_of("style parameter", name, parameters())
        return replace(self, **changes)

    def at(self, intensity: float) -> Style:
        """The style at another strength: 0 is neutral, 1 as it is, 1.5 exaggerated, below 0 its opposite.

        Numbers stay within their ranges.

        >>> Style("x", lean=0.33).at(0.5).lean
        0.18
        """
        return mix({self: intensity}, self.name if intensity == 1 else f"{self.name} x {intensity:g}")

    def values(self) -> dict[str, float]:
        """All numbers by name."""
        return {name: float(getattr(self, name)) for name in parameters()}


@dataclass(frozen=True)
class Parameter:
    """What a number of a style means, and where it may lie."""

    neutral: float
    low: float
    high: float
    unit: str
    about: str


def parameters() -> dict[str, Parameter]:
    """Every number of a style by name.

    >>> parameters()["tempo"].about
    'pace of everything: steps, gestures, breath'
    """
    return _PARAMETERS


_PARAMETERS = {f.name: Parameter(f.default, **f.metadata) for f in fields(Style) if f.name != "name"}


def mix(shares: Mapping[Style | str, float], name: str = "mix") -> Style:
    """Styles added up: neutral, plus for each style its share of the way there. Numbers stay within their ranges.

    shares: style (or its name) to share; two halves make the style in between, 1.5 of one exaggerates it. Raises
    MotionKitError for an unknown name and for a share that is not finite.

    >>> a, b = Style("a", lean=0.23), Style("b", slump=0.25)
    >>> both = mix({a: 0.5, b: 0.5})
    >>> round(both.lean, 3), round(both.slump, 3)
    (0.13, 0.15)
    """
    shares = {get_style(style): share for style, share in shares.items()}
    for style, share in shares.items():
        if not isinstance(share, int | float) or not math.isfinite(share):
            raise MotionKitError(f"the share of style {style.name!r} must be a finite number; found {share!r}")
    numbers = {}
    for key, about in parameters().items():
        value = about.neutral + sum(k * (getattr(s, key) - about.neutral) for s, k in shares.items())
        numbers[key] = round(min(max(value, about.low), about.high), 12)
    return Style(name, **numbers)


_LOW = {  # the posture of both the depressed and the tired: only their timing tells them apart
    "step_length": 0.66, "clearance": 0.035, "foot_roll": 0.45, "heel_strike": 0.12, "crouch": 0.035, "bob": 0.6,
    "sway": 1.3, "hip_turn": 0.05, "shoulder_turn": 0.04, "lean": 0.2, "slump": 0.52, "head_pitch": 0.55, "look": 0.03,
    "arm_swing": 0.13, "arm_out": 0.07, "arm_forward": 0.12, "arm_turn": 0.5, "elbow_bend": 0.22, "elbow_swing": 0.06,
    "shoulder_lift": -0.08, "reach": 0.68, "sharpness": 0.15, "follow_through": 0.32,
}  # fmt: skip
_HIGH = {  # and that of both the proud and the strutting
    "step_length": 1.08, "clearance": 0.12, "foot_roll": 1.0, "heel_strike": 0.36, "toe_out": 0.24, "crouch": 0.0,
    "bob": 1.4, "sway": 1.2, "hip_list": 0.08, "hip_turn": 0.17, "shoulder_turn": 0.26, "pelvis_tilt": 0.16,
    "lean": -0.09, "slump": -0.28, "head_pitch": -0.2, "arm_swing": 0.55, "arm_out": 0.36, "arm_turn": 0.45,
    "elbow_bend": 0.42, "elbow_swing": 0.3, "shoulder_lift": 0.04, "reach": 1.1, "sharpness": 0.5,
}  # fmt: skip

_STYLES = (
    Style("neutral"),
    Style("angry", tempo=1.3, step_length=1.05, step_width=0.17, foot_roll=0.7, heel_strike=0.4, crouch=0.03, bob=1.5,
          hip_turn=0.12, shoulder_turn=0.3, lean=0.24, slump=0.16, shoulder_lift=0.22, head_pitch=0.16, look=0.05,
          arm_swing=0.62, arm_out=0.34, arm_turn=0.6, elbow_bend=1.05, elbow_swing=0.35, hand_bend=0.3, sharpness=0.95,
          follow_through=0.06, reach=1.15),
    Style("childlike", tempo=1.2, step_length=0.86, clearance=0.2, foot_roll=1.0, bob=2.3, sway=1.6, variability=1.8,
          hip_list=0.1, hip_turn=0.15, shoulder_turn=0.3, side_bend=0.11, slump=-0.1, head_pitch=-0.12, head_tilt=0.06,
          look=0.3, arm_swing=0.85, arm_out=0.6, arm_turn=-0.1, elbow_bend=0.5, elbow_swing=0.5, hand_bend=-0.3,
          sharpness=0.55, reach=1.15),
    Style("depressed", tempo=0.95, **_LOW),
    Style("old", tempo=0.74, step_length=0.5, step_width=0.22, clearance=0.02, foot_roll=0.2, heel_strike=0.05,
          toe_out=0.3, knee_out=0.3, crouch=0.1, bob=0.5, sway=2.2, hip_list=0.04, hip_turn=0.03, shoulder_turn=0.03,
          side_bend=0.05, pelvis_tilt=0.1, lean=0.42, slump=0.42, shoulder_lift=0.1, head_pitch=-0.02, look=0.06,
          arm_swing=0.1, arm_out=0.24, arm_forward=0.3, arm_turn=0.35, elbow_bend=1.0, elbow_swing=0.08, hand_bend=0.25,
          reach=0.62, asymmetry=0.1, sharpness=0.2, tremor=0.025, variability=1.4),
    Style("proud", tempo=1.04, **_HIGH),
    Style("strutting", tempo=0.76, pauses=0.5, **_HIGH),
    Style("tired", tempo=0.58, pauses=0.25, **_LOW),
)  # fmt: skip

_HELD_OUT = (
    Style("sneaky", tempo=0.7, pauses=0.6, step_length=0.85, step_width=0.1, clearance=0.28, foot_roll=0.5,
          heel_strike=0.0, crouch=0.17, bob=1.6, hip_turn=0.12, shoulder_turn=0.12, lean=0.42, slump=0.25,
          shoulder_lift=0.3, head_pitch=-0.05, look=0.6, arm_swing=0.2, arm_out=0.2, arm_forward=0.75, arm_turn=0.4,
          elbow_bend=1.5, elbow_swing=0.15, hand_bend=0.7, reach=0.8, sharpness=0.35),
    Style("drunk", tempo=0.8, step_length=0.8, step_width=0.34, clearance=0.1, foot_roll=0.6, heel_strike=0.2,
          toe_out=0.35, crouch=0.05, sway=3.2, variability=4.0, hip_list=0.12, side_bend=0.12, lean=0.1, slump=0.15,
          head_pitch=0.2, head_tilt=0.15, look=0.25, arm_swing=0.35, arm_out=0.5, elbow_bend=0.5, wander=1.0, reach=0.9,
          follow_through=0.5, sharpness=0.25),
    Style("robot", tempo=0.85, pauses=0.88, step_length=0.75, clearance=0.12, foot_roll=0.0, heel_strike=0.0,
          toe_out=0.0, variability=0.0, bob=0.2, sway=0.5, hip_list=0.0, hip_turn=0.0, shoulder_turn=0.0, lean=0.0,
          slump=-0.05, head_pitch=0.0, look=0.0, arm_swing=0.5, arm_out=0.1, arm_turn=0.0, elbow_bend=1.57,
          elbow_swing=0.0, hand_bend=0.0, sharpness=1.0, follow_through=0.0),
    Style("zombie", tempo=0.62, pauses=0.3, asymmetry=0.35, step_length=0.55, step_width=0.24, clearance=0.015,
          foot_roll=0.15, heel_strike=0.0, toe_out=0.3, crouch=0.05, sway=2.6, hip_list=0.12, hip_turn=0.05,
          shoulder_turn=0.08, side_bend=0.12, lean=0.22, slump=0.3, head_pitch=0.05, head_tilt=0.32, arm_swing=0.06,
          arm_out=0.1, arm_forward=1.3, arm_turn=0.1, elbow_bend=0.25, elbow_swing=0.05, hand_bend=0.7, reach=0.8,
          wander=0.35, sharpness=0.3, follow_through=0.3),
)  # fmt: skip

TRAIN_STYLES = tuple(s.name for s in _STYLES)
HELD_OUT_STYLES = tuple(s.name for s in _HELD_OUT)
_BY_NAME = {s.name: s for s in (*_STYLES, *_HELD_OUT)}


def get_style(name: str | Style) -> Style:
    """A style by name (a `Style` is passed on); MotionKitError names the nearest.

    >>> get_style("old").step_length
    0.5
    """
    if isinstance(name, Style):
        return name
    return _BY_NAME[check.one_of("style", name, _BY_NAME, hint="; or make a Style(...) of your own")]
