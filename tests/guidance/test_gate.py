import math
import random

from circumnav_mav.guidance.estimators.gate import VOTES, refuse, remember
from circumnav_mav.guidance.kernel import ACCEPTED, OUTLIER, RESTARTED, Memory


def test_readings_that_agree_win():
    mem = Memory(known=1.0)
    for n in range(int(VOTES)):
        mem = refuse(mem, 100.0 - n, 0.1, 10.0, 2.0)
        assert mem.verdict == (OUTLIER if n < VOTES - 1 else RESTARTED)
    assert mem.votes == 0.0


def test_readings_that_disagree_do_not():
    draw = random.Random(2)
    mem = Memory(known=1.0)
    for _ in range(500):
        mem = refuse(mem, 100.0 + draw.expovariate(1.0 / 40.0), 0.1, 10.0, 0.5)
        assert mem.verdict == OUTLIER


def test_good_readings_speak_against_the_rival():
    mem = Memory(known=1.0)
    for _ in range(200):
        for r in (90.0, 90.0):
            mem = refuse(mem, r, 0.1, 1.0, 1.0)
            assert mem.verdict == OUTLIER
        for _ in range(3):
            mem = remember(mem, 0.1, 1.0, 1.0, 1.0)
            assert mem.verdict == ACCEPTED


def test_a_rival_may_move_as_fast_as_a_vehicle_closes_but_no_faster():
    slow = fast = Memory(known=1.0)
    for n in range(int(VOTES)):
        slow = refuse(slow, 200.0 - 9.0 * n, 1.0, 10.0, 0.1)
        fast = refuse(fast, 200.0 - 30.0 * n, 1.0, 10.0, 0.1)
    assert slow.verdict == RESTARTED
    assert fast.verdict == OUTLIER
    assert math.isnan(slow.rival_r)
