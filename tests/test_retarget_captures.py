"""Retargeting 30 real captures to the 22-joint skeleton: feet, joint angles, twist, and no pops."""

import random
import zipfile

import pytest
import torch
from rigs import flexion

import motionkit as mk
from motionkit import Motion
from motionkit import rotations as rot
from motionkit.contacts import feet_of, foot_contacts, foot_sliding
from motionkit.skeleton import smpl


def fastest_change(motion: Motion) -> float:
    """The largest acceleration of a limb's joint, metres a second squared."""
    places = motion.positions()[:, sorted(motion.skeleton.roles.values())]
    return float((places[2:] - 2 * places[1:-1] + places[:-2]).norm(dim=-1).max()) * motion.fps**2


@pytest.fixture(scope="module")
def clips(captures, tmp_path_factory) -> list[tuple[Motion, Motion]]:
    """30 captures of all kinds, each with itself on the 22-joint skeleton."""
    folder, found = tmp_path_factory.mktemp("clips"), []
    with zipfile.ZipFile(captures) as archive:
        members = sorted(n for n in archive.namelist() if "dataset-2_" in n and n.endswith(".bvh"))
        for n, member in enumerate(random.Random(0).sample(members, 30)):
            path = folder / f"{n}.bvh"
            path.write_bytes(archive.read(member))
            motion = mk.load(path)
            found.append((motion, mk.retarget(motion, smpl())))
    return found


def test_captures_keep_their_angles(clips):
    for source, result in clips:
        assert (flexion(source, "elbow") - flexion(result, "elbow")).abs().max() < 1
        assert (flexion(source, "knee") - flexion(result, "knee")).abs().median() < 3


def test_captures_keep_their_feet_on_the_ground(clips):
    for source, result in clips:
        contacts = foot_contacts(source)
        slid = foot_sliding(source, contacts)
        assert foot_sliding(result, contacts) < max(2.0, 1.1 * slid)
        places = result.positions()[:, feet_of(result), 1]
        toes = places[:, [1, 3]]
        assert toes.min() > 0.02 - 0.005  # the toe's joint is 2 cm over the sole
        floor = torch.quantile(toes[contacts[:, [1, 3]]], 0.02)
        assert abs(float(floor) - 0.02) < 0.002


def test_captures_do_not_pop(clips):
    assert max(fastest_change(result) / fastest_change(source) for source, result in clips) < 1.3


def test_captures_come_out_as_bodies(clips):
    """Twist: heads face ahead, knees and elbows bend about their hinge, no collar or spine is turned about itself."""
    for source, result in clips:
        turn = rot.log_map(result.rotations.double())  # [F, 22, 3]
        for name, axis in (("left_knee", 0), ("right_knee", 0)):
            knee = turn[:, smpl().index(name)]
            assert (knee[:, axis] > -0.05).all() and knee.abs().mean(0).argmax() == axis
        for name in ("spine1", "spine2", "spine3", "neck", "left_collar", "right_collar", "left_foot", "right_foot"):
            assert turn[:, smpl().index(name)].mean(0).norm() < torch.pi / 4, (source, name)
        ahead = rot.quaternion_rotate(
            result.world_rotations()[:, 15], torch.tensor([0.0, 0.0, 1.0]).expand(len(result), 3)
        )
        aside = rot.wrap_angle(rot.direction_to_yaw(ahead) - result.facing())
        assert aside.median().abs() < torch.pi / 4


def test_a_capture_on_another_of_its_kind_is_itself(clips):
    source, _ = clips[0]
    assert (mk.retarget(source, source.skeleton).positions() - source.positions()).abs().max() < 1e-4


def test_a_mirrored_capture_gives_the_mirrored_result(clips):
    for source, result in clips[:6]:
        mirrored = mk.retarget(source.mirror(), smpl())
        assert (mirrored.positions() - result.mirror().positions()).norm(dim=-1).max() < 0.005
