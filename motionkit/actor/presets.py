"""The styles that the performer knows by name."""

from __future__ import annotations

from ..errors import MotionKitError
from .style import Style, nearest

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

_UNSEEN = (
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

SEEN = tuple(s.name for s in _STYLES)
UNSEEN = tuple(s.name for s in _UNSEEN)
_BY_NAME = {s.name: s for s in (*_STYLES, *_UNSEEN)}


def style_named(name: str | Style) -> Style:
    """A style by name (a `Style` is passed on); MotionKitError names the nearest.

    >>> style_named("old").step_length
    0.5
    """
    if isinstance(name, Style):
        return name
    if not isinstance(name, str) or name not in _BY_NAME:
        raise MotionKitError(f"no style {name!r}; {nearest(name, _BY_NAME)}; or make a Style(...) of your own")
    return _BY_NAME[name]
