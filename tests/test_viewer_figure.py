"""Figures: bones, sizes, places beside each other, contacts, and what is sent to the browser."""

import numpy as np
import pytest
from looking import clip, dog

import motionkit as mk
from motionkit.viewer import figure as bodies


def test_a_root_left_on_the_ground_is_no_bone_and_does_not_count_for_size(walk):
    assert (0, 1) not in bodies.figures(dog())[0].bones
    assert 0 not in bodies.figures(dog())[0].drawn
    assert 0.5 < bodies.figures(dog())[0].size < 1.3
    assert len(bodies.figures(walk)[0].bones) == len(walk.skeleton.names) - 1  # a root at the hips stays


def test_what_is_sent_is_within_a_tenth_of_a_millimetre_and_small(walk):
    head, (found,) = bodies.decode_scene(mk.Player(walk)._data)
    assert np.abs(found - walk.positions().numpy()).max() < 1e-4
    assert len(mk.Player(walk)._data) < 22_000  # 4 s of 22 joints
    far = clip(np.random.default_rng(1).uniform(-30, 30, (50, 5, 3)), [-1, 0, 1, 2, 3])
    assert np.abs(bodies.decode_scene(mk.Player(far)._data)[1][0] - far.points.numpy()).max() < 1e-3


def test_side_by_side_leaves_room_and_overlay_leaves_places(walk, proud):
    made = bodies.figures([walk, proud, walk])
    starts = np.stack([f.points[0].mean(axis=0) for f in made])
    gaps = np.linalg.norm(np.diff(starts[:, [0, 2]], axis=0), axis=1)
    assert gaps == pytest.approx([gaps[0]] * 2, abs=1e-4) and gaps[0] > 0.6
    assert np.array_equal(bodies.figures([walk, proud], layout="overlay")[1].points, proud.positions().numpy())
    # whoever faces +Z has its left hand at +X, which a viewer in front sees at the right
    assert starts[0, 0] < starts[1, 0] < starts[2, 0]


def test_on_a_treadmill_nobody_leaves_the_spot_and_the_body_moves_as_before(walk, proud):
    made = bodies.figures([walk, proud], layout="treadmill")
    for figure, motion in zip(made, (walk, proud)):
        places = motion.positions().numpy()
        assert np.ptp(places[:, 0, 2]) > 1.5 and np.ptp(figure.points[:, 0, [0, 2]], axis=0).max() < 0.25
        around, before = (x - x[:, :1] for x in (figure.points, places))
        assert np.abs(around - before).max() < 1e-4 and np.allclose(figure.points[..., 1], places[..., 1], atol=1e-5)
    assert abs(made[0].points[0, 0, 0] - made[1].points[0, 0, 0]) > 0.6
    one = bodies.figures(walk[:1], layout="treadmill")[0]
    assert one.points.shape == (1, 22, 3) and np.isfinite(one.points).all()


def test_contacts_in_every_form_say_the_same(walk):
    from motionkit.contacts import feet_of, foot_contacts

    table, feet = foot_contacts(walk), feet_of(walk)
    names = [walk.skeleton.names[j] for j in feet]
    forms = [True, table, (names, table), {n: table[:, k] for k, n in enumerate(names)}, [table]]
    sent = {mk.Player(walk, contacts=form)._data for form in forms}
    assert len(sent) == 1
    assert bodies.decode_scene(sent.pop())[0]["motions"][0]["marks"] == feet


def test_a_body_seen_from_the_front_has_its_left_hand_at_the_right():
    right, up, near = bodies.view_axes(np.float32([1, 0, 0]), turn=0.0, rise=0.0)
    assert right == pytest.approx([1, 0, 0]) and up == pytest.approx([0, 1, 0]) and near == pytest.approx([0, 0, 1])
    axes = bodies.view_axes(np.float32([0.6, 0, 0.8]))
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-6) and np.linalg.det(axes) == pytest.approx(1)
