"""Makes the pictures of a captured walk for notebook 03, for readers who have no captures.

MOTIONKIT_DATA=FOLDER python tools/picture_capture.py      (a folder with Bandai-2 or its archive)
"""

import io
from pathlib import Path

import motionkit as mk
from motionkit import actor
from motionkit.datasets.captures import SMPL_NAMES
from motionkit.viewer.plots import few_colours

PICTURES = Path(__file__).resolve().parent.parent / "notebooks" / "pictures"
SHOWN = ("Hips", "Hand_L", "LowerLeg_L", "Foot_L")


def main() -> None:
    """A strip of poses, and speeds by frequency; no captured clip leaves as numbers."""
    clips = [c.motion for c in mk.datasets.load("bandai-2").filter(content="walk", style="normal") if len(c) >= 60]
    person = actor.Performer(height=1.63)  # as tall as those captured
    made = [actor.perform("walk", seed=n, seconds=5, performer=person).motion for n in range(20)]
    captured = mk.retarget(clips[0], person.skeleton)
    pictures = {
        "captured_walk": mk.strip([captured[40:100], made[0][:60]], labels=["captured", "performer"], poses=7),
        "captured_speeds": mk.lessons.data.plot_speed_bands(clips, made, {name: SMPL_NAMES[name] for name in SHOWN}),
    }
    for name, picture in pictures.items():
        raw = io.BytesIO()
        picture.savefig(raw, format="png", facecolor="white", dpi=90)
        (PICTURES / f"{name}.png").write_bytes(few_colours(raw))
        print(f"{name}.png: {len(raw.getvalue())} bytes")


if __name__ == "__main__":
    main()
