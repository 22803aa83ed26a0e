"""Colours that everybody can tell apart."""

import numpy as np
import pytest

from motionkit.viewer import colours


def lightness(colour: str) -> float:
    linear = [((c + 0.055) / 1.055) ** 2.4 if c > 0.04 else c / 12.92 for c in colours.rgb(colour)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


# Viénot, Brettel and Mollon 1999: what is left of linear red, green and blue without one kind of cone.
BLIND = {"red": [[0.11238, 0.88762, 0], [0.11238, 0.88762, 0], [0.00401, -0.00401, 1]],
         "green": [[0.29275, 0.70725, 0], [0.29275, 0.70725, 0], [-0.02234, 0.02234, 1]]}  # fmt: skip


@pytest.mark.parametrize("kind", BLIND)
def test_sides_and_roles_stay_apart_for_colour_blind_eyes(kind):
    for group in (colours.SIDES, colours.ROLES):
        seen = [np.asarray(BLIND[kind]) @ np.array(colours.rgb(c)) ** 2.2 for c in group.values()]
        for n, a in enumerate(seen):
            for b in seen[:n]:
                assert np.abs(np.clip(a, 0, 1) ** (1 / 2.2) - np.clip(b, 0, 1) ** (1 / 2.2)).sum() > 0.3
    assert lightness(colours.LEFT) > 1.5 * lightness(colours.RIGHT)
