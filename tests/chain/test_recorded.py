"""What a link reads in time: its series, and whether it asks for a shot's time at all."""

import numpy as np
import pytest

import whiskjax as wj

TIME_S, ANGLE_RAD = np.array([0.0, 1.0, 2.5]), np.array([0.0, 0.1, 0.3])
UNIT = [[0, 0, 0, 1.0]] * 3
ENCODER = wj.Encoder(TIME_S, ANGLE_RAD, 2.0)
# Each link with the delays of its series.
LINKS = {
    "POS": (wj.Trajectory(TIME_S, np.zeros((3, 3)), UNIT, max_gap_s=2.0, delay_s=0.25), (0.25,)),
    "POS whose attitude is late": (
        wj.Trajectory(TIME_S, np.zeros((3, 3)), UNIT, max_gap_s=2.0, delay_s=0.25, attitude_delay_s=0.5),
        (0.25, 0.75),
    ),
    "encoder": (wj.Turn("x", ENCODER, delay_s=0.125), (0.125,)),
    "readings": (wj.Turn("x", wj.Readings(0.1)), ()),
    "poses": (wj.PosePerImage(np.zeros((3, 3)), UNIT), ()),
    "mount": (wj.Mount(), ()),
    "correction": (wj.Correction(wj.Bias()), ()),
    "one of two": (wj.By("image", {"a": wj.Mount(), "b": wj.Turn("x", ENCODER)}), (0.0,)),
    "one of none": (wj.By("image", {"a": wj.Mount(), "b": wj.Mount()}), ()),
}


@pytest.mark.parametrize("name", LINKS)
def test_a_link_lists_its_series_with_their_delays(name):
    link, delays_s = LINKS[name]
    assert [float(record.delay_s) for record in link.recorded] == list(delays_s)
    for record in link.recorded:
        np.testing.assert_array_equal(record.knots.time_s, TIME_S)
        assert record.knots.max_gap_s == 2.0
    # What the search along time is told are the same series.
    moves = link.moves(wj.Shot(time_s=1.0, image=np.array([0, 1])))
    assert [float(record.delay_s) for record in moves.recorded] == list(delays_s)


@pytest.mark.parametrize("name", LINKS)
def test_links_in_time_are_those_that_refuse_a_shot_without_one(name):
    link, _ = LINKS[name]
    shot = wj.Shot(image=1)
    if not link.is_timed:
        assert link.pose(shot).matrix.shape[-2:] == (3, 3)
    else:
        with pytest.raises(wj.WhiskjaxError, match="time_s"):
            link.pose(shot)
