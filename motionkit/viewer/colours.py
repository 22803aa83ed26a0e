"""The kit's colours: limbs by side, characters by role. Every picture takes them from here.

All are told apart with the common forms of colour blindness: they come from the Okabe-Ito set, made a little calmer,
and differ in lightness as well as in hue.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..errors import MotionKitError

LEFT = "#dd7331"
RIGHT = "#2b6ca8"
MIDDLE = "#85909c"
SIDES = {"left": LEFT, "right": RIGHT, "middle": MIDDLE}

# Content green, style light blue, result yellow: as in the figures of paper 1.
ROLES = {"content": "#2f9e77", "style": "#62b5e5", "result": "#edc53f"}

# Further characters, in this order; neighbours differ in hue and in lightness.
CYCLE = ("#62b5e5", "#edc53f", "#2f9e77", "#c77ba8", "#d3622b", "#5b5ea6", "#9c9c9c", "#7d5a44")

# A darkened yellow turns olive; this is what the eye takes for its shade.
_DEEP = {ROLES["result"]: "#c8901f"}

CONTACT = "#c2417c"
NEVER = "#9c9c9c"  # a number that does not change


def mix(colour: str, other: str, share: float) -> str:
    """`colour` with `share` (0 to 1) of `other` in it, both `#rrggbb`.

    >>> mix("#000000", "#ffffff", 0.5)
    '#808080'
    """
    a, b = rgb(colour), rgb(other)
    return "#" + "".join(f"{round(255 * (x + (y - x) * share)):02x}" for x, y in zip(a, b))


def rgb(colour: str) -> tuple[float, float, float]:
    """`#rrggbb` as three numbers from 0 to 1.

    >>> rgb("#ff0000")
    (1.0, 0.0, 0.0)
    """
    return tuple(int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))


def role_colour(role: str | None, index: int = 0) -> str:
    """The colour of a role (`content`, `style`, `result`), a `#rrggbb` as it is, or the index-th further character's.

    >>> role_colour("content"), role_colour("#102030"), role_colour(None, 1) == CYCLE[1]
    ('#2f9e77', '#102030', True)
    """
    if role is None:
        return CYCLE[index % len(CYCLE)]
    if role in ROLES:
        return ROLES[role]
    if len(role) == 7 and role[0] == "#" and all(c in "0123456789abcdefABCDEF" for c in role[1:]):
        return role.lower()
    raise MotionKitError(f"role {role!r}: expected one of {', '.join(ROLES)}, a colour such as '#2f9e77', or None")


def limb_colours(sides: Sequence[str], colour: str | None = None) -> list[str]:
    """A colour for each joint: by side, or, for a character of one `colour`, left a shade darker and right lighter.

    sides: J words of left, right, middle. Returns J colours `#rrggbb`.

    >>> limb_colours(["left", "middle"]) == [LEFT, MIDDLE]
    True
    """
    if colour is None:
        return [SIDES[s] for s in sides]
    deep = _DEEP.get(colour, mix(colour, "#10202c", 0.34))
    shades = {"left": deep, "right": mix(colour, "#ffffff", 0.28), "middle": colour}
    return [shades[s] for s in sides]
