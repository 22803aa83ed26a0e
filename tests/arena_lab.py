"""What the arena's tests share: a few performed clips, a judge that needs no training, and methods that misbehave."""

import time
from pathlib import Path

import torch

import motionkit as mk
from motionkit.arena.transfers import one_thread
from motionkit.datasets import Split, performed
from motionkit.datasets.loading import from_items

CONTENTS, STYLES = ("jump", "walk", "wave"), ("neutral", "old", "proud")
HEIGHTS = ("pelvis", "left_wrist", "right_ankle", "head")


def numbers(motion):
    """Heights of some joints, mean and spread, [8]."""
    places = motion.positions()[:, [motion.skeleton.index(j) for j in HEIGHTS], 1]
    return torch.cat((places.mean(0), places.std(0, correction=0))) * 10


class Half:
    """Takes a motion for what the nearest clip that it knows is."""

    def __init__(self, clips, label):
        self.labels = tuple(sorted({getattr(clip, label) for clip in clips}))
        self.skeleton, self.fps = clips[0].motion.without_helper_joints().skeleton, 30.0
        self.known = torch.stack([numbers(clip.motion) for clip in clips])
        self.right = self.ids([getattr(clip, label) for clip in clips])

    def ids(self, labels):
        return torch.tensor([self.labels.index(label) for label in labels])

    def features(self, motions):
        return torch.stack([numbers(m) for m in motions])

    def scores_and_features(self, motions):
        found = self.features(motions)
        away = torch.cdist(found, self.known)
        scores = torch.stack([away[:, self.right == n].amin(1) for n in range(len(self.labels))], 1)
        return (-scores).log_softmax(1), found


class Judge:
    def __init__(self, clips):
        self.name, self.content, self.style = "nearest", Half(clips, "content"), Half(clips, "style")
        self.autoencoder = self.content


def small_split() -> Split:
    """A take to train on and one to test on, of three contents in three styles."""
    chosen = [i for i in performed.items("actor") if i.labels.content in CONTENTS and i.labels.style in STYLES]
    wanted = [i for i in chosen if i.name[-2:] in ("00", "14")]
    with one_thread():
        return from_items("actor", wanted).split()


def copy_content(content, style):
    return content


def copy_style(content, style):
    return style.replace(skeleton=content.skeleton)


def noisy(content, style):
    """Uses chance, so that a table tells whether chance is seeded."""
    moves = content.translations.clone()
    moves[:, 0] += 0.01 * torch.randn(len(content), 3)
    return content.replace(translations=moves)


def moody(content, style):
    """Every way to fail, by content and style."""
    if "old" in style.name:
        raise ValueError("no old people\nplease")
    if "proud" in style.name:
        return "a string" if "wave" in content.name else content[:0]
    if "wave" in content.name:
        broken = content.transform()
        broken.rotations[3] = torch.nan
        return broken
    if "jump" in content.name:
        return mk.Motion.from_root(
            mk.Skeleton(("a",), (-1,), torch.zeros(1, 3)), torch.ones(5, 1, 4) / 2, torch.zeros(5, 3), 30
        )
    return content


class Counting:
    """Copies the content, slowly, and writes down every call. Is interrupted after as many as a file beside says."""

    name = "counting"

    def __init__(self, log, slow=0.0):
        self.log, self.slow = str(log), slow

    def calls(self):
        return Path(self.log).read_text().split() if Path(self.log).exists() else []

    def stylize(self, content, style):
        stop = Path(self.log + ".stop")
        if stop.exists() and len(self.calls()) >= int(stop.read_text()):
            raise KeyboardInterrupt
        with open(self.log, "a") as file:
            file.write(f"{content.name}>{style.name}\n")
        time.sleep(self.slow)
        return content
