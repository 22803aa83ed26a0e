"""The style lesson: a BVH file goes in, its style is learned and played; what is wrong is told there."""

import datetime
import io
from pathlib import Path
from types import SimpleNamespace

import pytest
from PIL import Image

import motionkit as mk
from motionkit.lessons.few_shot import StyleLesson

WALK, JUMP = (mk.load(f"data/actor/{deed}_neutral.bvh") for deed in ("walk", "jump"))
CONTENTS = {"a person walks": WALK, "a person jumps": JUMP}


class Acted:
    """Learns at once, refuses a sentence without words, and restyles by a name."""

    def __init__(self):
        self.asked = []

    def learn(self, clip, prompt, title):
        if not prompt:
            raise mk.MotionKitError("the prompt is empty")
        self.clip = clip
        return SimpleNamespace(name=prompt.split()[-1])

    def stylize(self, content, style, strength, labels):
        self.asked.append((content.name, style.name, strength, labels.caption))
        return content.replace(name=f"{content.name} as {style.name}")


@pytest.fixture
def lesson():
    return StyleLesson(Acted(), CONTENTS)


def upload(lesson, name, content):
    file = {"name": name, "content": memoryview(content), "type": "", "size": len(content)}
    lesson.controls["file"].value = (file | {"last_modified": datetime.datetime.now()},)


def test_a_file_is_learned_and_played(lesson):
    assert lesson.results == [] and lesson.player.motions == [WALK]
    upload(lesson, "mine.bvh", Path("data/actor/walk_old.bvh").read_bytes())
    assert lesson.message.startswith("mine: ") and lesson.message.endswith("s; now say what it does, and how")
    lesson.controls["prompt"].value = "a person walks like a king"
    lesson.button.click()
    assert lesson._method.clip.name == "mine" and lesson.message.startswith("learned 'king' from 'mine'")
    assert lesson.player.motions == [WALK, *lesson.results] and lesson.results[0].name == "walk_neutral as king"
    lesson.controls["content"].value = "a person jumps"
    lesson.controls["strength"].value = 1.5
    assert lesson._method.asked[-1] == ("jump_neutral", "king", 1.5, "a person jumps")
    assert lesson.player.motions[0] is JUMP


def test_a_first_clip_is_learned_at_once():
    lesson = StyleLesson(Acted(), CONTENTS, mk.load("data/actor/walk_old.bvh"), "a person walks old")
    assert lesson.learned.name == "old" and lesson.results[0].name == "walk_neutral as old"
    with pytest.raises(mk.MotionKitError, match="the prompt is empty"):
        StyleLesson(Acted(), CONTENTS, WALK)


def test_all_contents_are_played_side_by_side():
    lesson = StyleLesson(Acted(), CONTENTS, mk.load("data/actor/walk_old.bvh"), "a person walks old")
    lesson.controls["content"].value = "all of them"
    assert lesson.player.motions == lesson.results
    assert [one.name for one in lesson.results] == ["walk_neutral as old", "jump_neutral as old"]
    assert lesson._method.asked[-1] == ("jump_neutral", "old", 1.0, "a person jumps")
    assert lesson.player._shown["labels"] == ["walks", "jumps"] and len(lesson.still()) > 10_000
    fresh = StyleLesson(Acted(), CONTENTS)
    fresh.controls["content"].value = "all of them"
    assert fresh.player.motions == [WALK, JUMP] and len(fresh.still()) > 10_000
    assert "all of them" not in StyleLesson(Acted(), {"a person walks": WALK}).controls["content"].options


def test_what_is_wrong_is_told_and_the_style_before_stays(lesson):
    lesson.button.click()
    assert lesson.message == "no clip was given yet: choose a BVH file first" and not lesson.button.disabled
    upload(lesson, "cut.bvh", b"HIERARCHY ROOT a {")
    assert "cut.bvh, line" in lesson.message and "&" not in lesson.message
    upload(lesson, "mine.bvh", Path("data/actor/walk_old.bvh").read_bytes())
    lesson.button.click()
    assert lesson.message == "the prompt is empty" and lesson.learned is None
    lesson.controls["content"].value = "a person jumps"
    assert lesson.player.motions == [JUMP]


def test_a_page_without_a_kernel_gets_a_picture(lesson):
    before = lesson.still()
    assert "image/png" in lesson._repr_mimebundle_() and len(before) < 60_000
    upload(lesson, "mine.bvh", Path("data/actor/walk_old.bvh").read_bytes())
    lesson.controls["prompt"].value = "a person walks proudly"
    lesson.button.click()
    sizes = [Image.open(io.BytesIO(png)).size for png in (before, lesson.still())]
    assert sizes[1][1] > sizes[0][1]


def test_contents_are_needed():
    for wrong in ({}, {"a person walks": "walk.bvh"}):
        with pytest.raises(mk.MotionKitError, match="expected contents by their captions"):
            StyleLesson(Acted(), wrong)
