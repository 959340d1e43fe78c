"""Who flies: every row of the authority's table, and when a setpoint may leave. Driven by mode messages alone."""

from __future__ import annotations

import itertools

import pytest

from circumnav_mav.mavlink.autopilot import Autopilot
from circumnav_mav.mavlink.codec import Message
from circumnav_mav.mavlink.dialect import by_name
from circumnav_mav.mavlink.offboard import ASKS, Authority, Control, Seen
from circumnav_mav.mavlink.px4_modes import HOLD, OFFBOARD, RETURN

POSITION = 0x00030000


class Bench:
    """An authority fed by hand-made mode messages on a hand-made clock."""

    def __init__(self) -> None:
        self.autopilot = Autopilot()
        self.authority = Authority(self.autopilot)
        self.now_s = 10.0
        self.seq = 0

    def show(self, custom: int, intended: int | None = None, *, armed: bool = True, status: int = 4) -> Bench:
        """The autopilot shows a mode, in HEARTBEAT and (unless intended is None) in CURRENT_MODE."""
        self.now_s += 0.1
        heartbeat = by_name("HEARTBEAT").make((custom, 2, 12, 0x80 if armed else 0, status, 3))
        self._message("HEARTBEAT", heartbeat)
        if intended is not None:
            self._message("CURRENT_MODE", by_name("CURRENT_MODE").make((custom, intended, 0)))
        self.authority.on_mode(self.now_s)
        return self

    def _message(self, name, fields) -> None:
        self.seq = (self.seq + 1) % 256
        self.autopilot.on_message(Message(name, 1, 1, self.seq, fields), self.now_s)

    def stream(self) -> Bench:
        assert self.authority.may_stream(self.now_s), self.authority.why_not(self.now_s)
        self.authority.sent(self.now_s)
        return self

    def held(self) -> Bench:
        self.show(HOLD, HOLD).stream().show(OFFBOARD, OFFBOARD)
        assert self.authority.control is Control.HELD
        return self

    @property
    def control(self) -> Control:
        return self.authority.control

    @property
    def streams(self) -> bool:
        return self.authority.may_stream(self.now_s)


def test_the_pilot_engages_while_we_stream():
    bench = Bench().held()
    assert bench.authority.reason == "the pilot selected Offboard"


def test_offboard_that_we_did_not_stream_for_is_never_joined():
    """A restart in flight: OFFBOARD is shown, but another process (or nobody) streamed for it."""
    bench = Bench().show(OFFBOARD, OFFBOARD)
    assert bench.control is Control.NOT_HELD
    assert not bench.streams
    assert "choose another mode" in bench.authority.why_not(bench.now_s)


@pytest.mark.parametrize(
    ("custom", "intended", "armed", "status", "streams"),
    [
        (HOLD, HOLD, True, 4, True),
        (HOLD, HOLD, False, 3, True),
        (POSITION, POSITION, True, 4, True),
        (HOLD, OFFBOARD, True, 5, False),  # offboard loss: a resumed stream takes the aircraft back
        (HOLD, OFFBOARD, True, 4, False),
        (HOLD, HOLD, True, 5, False),  # some failsafe
        (HOLD, RETURN, True, 4, False),
        (HOLD, None, True, 4, False),  # an autopilot without CURRENT_MODE
        (HOLD, 0, True, 4, False),  # 0: not supplied
        (OFFBOARD, OFFBOARD, True, 4, False),
        (OFFBOARD, OFFBOARD, False, 3, False),
    ],
)
def test_streaming_early_only_where_a_stream_cannot_take_the_aircraft(custom, intended, armed, status, streams):
    bench = Bench().show(custom, intended, armed=armed, status=status)
    assert bench.streams is streams
    assert bool(bench.authority.why_not(bench.now_s)) is not streams


def test_nothing_streams_before_the_first_mode_message():
    assert not Bench().streams


@pytest.mark.parametrize(
    ("shown", "words"),
    [
        ({"custom": HOLD, "intended": HOLD}, "chose Hold"),
        ({"custom": POSITION, "intended": OFFBOARD, "status": 5}, "failsafe"),
        ({"custom": HOLD, "intended": OFFBOARD, "status": 5}, "failsafe"),
        ({"custom": RETURN, "intended": None}, "chose Return|left Offboard for Return"),
        ({"custom": OFFBOARD, "intended": OFFBOARD, "armed": False}, "disarmed"),
    ],
)
def test_offboard_left_without_our_asking_is_released_and_latched(shown, words):
    bench = Bench().held().show(**shown)
    assert bench.control is Control.RELEASED
    import re

    assert re.search(words, bench.authority.reason)
    for custom, intended, status in itertools.product((HOLD, OFFBOARD), (HOLD, OFFBOARD, None), (4, 5)):
        bench.show(custom, intended, status=status)
        assert bench.control is Control.RELEASED
        assert not bench.streams
        assert bench.authority.poll(bench.now_s) == []


def test_after_a_release_no_mode_is_ever_asked_for():
    bench = Bench().held().show(HOLD, HOLD)
    bench.authority.ask(bench.now_s)
    bench.authority.give_back(RETURN, bench.now_s, "range lost")
    assert bench.control is Control.RELEASED
    assert bench.authority.poll(bench.now_s + 10) == []


def test_the_latch_opens_on_command_only_in_a_settled_mode():
    bench = Bench().held().show(HOLD, OFFBOARD, status=5)
    assert not bench.authority.open_latch()
    bench.show(OFFBOARD, OFFBOARD)
    assert not bench.authority.open_latch()
    bench.show(HOLD, HOLD)
    assert bench.authority.open_latch()
    assert bench.control is Control.NOT_HELD
    assert bench.streams


def test_a_gap_stops_the_stream_until_a_newer_mode_message():
    bench = Bench().held().stream()
    bench.authority.gap(bench.now_s)
    assert not bench.streams
    assert bench.authority.seen() is Seen.NOTHING
    bench.show(OFFBOARD, OFFBOARD)
    assert bench.control is Control.HELD
    assert bench.streams


def test_a_gap_that_the_failsafe_used_ends_in_a_release():
    bench = Bench().held()
    bench.authority.gap(bench.now_s)
    bench.show(HOLD, OFFBOARD, status=5)
    assert bench.control is Control.RELEASED
    assert not bench.streams


def test_a_silent_autopilot_gets_no_setpoints():
    bench = Bench().held()
    bench.now_s += 4.0
    assert not bench.streams


def test_offboard_is_asked_for_behind_a_setpoint_and_believed_by_the_mode_alone():
    bench = Bench().show(HOLD, HOLD)
    bench.authority.ask(bench.now_s)
    assert bench.authority.poll(bench.now_s) == [], "asked before the first setpoint"
    bench.stream()
    assert [r.custom_mode for r in bench.authority.poll(bench.now_s)] == [OFFBOARD]
    assert bench.control is Control.ASKED
    bench.show(HOLD, HOLD)
    assert bench.control is Control.ASKED
    bench.show(OFFBOARD, OFFBOARD)
    assert bench.control is Control.HELD


def test_a_refusal_is_found_out_by_time_and_latched():
    bench = Bench().show(HOLD, HOLD)
    bench.authority.ask(bench.now_s)
    requests = 0
    while bench.control is Control.ASKED:
        bench.show(HOLD, HOLD).stream()
        requests += len(bench.authority.poll(bench.now_s))
        assert bench.now_s < 30.0
    assert requests == ASKS
    assert bench.authority.refused
    assert "did not enter Offboard" in bench.authority.reason


def test_a_pilot_who_chooses_while_we_ask_wins():
    bench = Bench().show(HOLD, HOLD)
    bench.authority.ask(bench.now_s)
    bench.stream().show(RETURN, RETURN)
    assert bench.control is Control.RELEASED


def test_handing_over_asks_for_the_mode_streams_until_it_is_shown_and_then_not():
    bench = Bench().held()
    bench.authority.give_back(HOLD, bench.now_s, "the end")
    assert [r.custom_mode for r in bench.authority.poll(bench.now_s)] == [HOLD]
    assert bench.streams
    bench.show(HOLD, HOLD)
    assert bench.control is Control.GIVEN_BACK
    assert not bench.streams
    bench.show(HOLD, HOLD)
    assert bench.control is Control.NOT_HELD


def test_the_stream_before_a_hand_over_does_not_count_for_an_engagement_after_it():
    bench = Bench().held().stream()
    bench.authority.give_back(HOLD, bench.now_s, "range lost")
    bench.show(HOLD, HOLD).show(HOLD, HOLD)
    assert bench.control is Control.NOT_HELD
    bench.show(OFFBOARD, OFFBOARD)
    assert bench.control is Control.NOT_HELD
    bench.show(HOLD, HOLD).stream().show(OFFBOARD, OFFBOARD)
    assert bench.control is Control.HELD


def test_stop_is_silence_without_a_mode_request():
    bench = Bench().held()
    bench.authority.give_back(None, bench.now_s, "range lost: stop")
    assert not bench.streams
    assert bench.authority.poll(bench.now_s) == []
    bench.show(POSITION, OFFBOARD, status=5)
    assert bench.control is Control.GIVEN_BACK
    assert not bench.streams


def test_an_old_mode_that_arrives_late_is_not_a_new_choice():
    """A reordered link delivers the Hold heartbeat of before behind the CURRENT_MODE of Offboard."""
    bench = Bench().held()
    late = by_name("HEARTBEAT").make((HOLD, 2, 12, 0x80, 4, 3))
    bench.autopilot.on_message(Message("HEARTBEAT", 1, 1, (bench.seq - 3) % 256, late), bench.now_s)
    bench.authority.on_mode(bench.now_s)
    assert bench.control is Control.HELD


@pytest.mark.parametrize("armed", [0, 0x80])
def test_a_heartbeat_under_the_autopilots_ids_that_names_no_autopilot_is_not_believed(armed):
    """A beacon's script that says it is 1/1: its mode 0 is no pilot's choice, and it does not keep a link alive."""
    bench = Bench().held()
    before_s = bench.autopilot.mode_s
    beacon = by_name("HEARTBEAT").make((0, 18, 8, armed, 4, 3))
    bench.now_s += 0.1
    bench._message("HEARTBEAT", beacon)
    bench.authority.on_mode(bench.now_s)
    assert bench.control is Control.HELD
    assert (bench.autopilot.custom_mode, bench.autopilot.mode_s, bench.autopilot.kind) == (OFFBOARD, before_s, 12)


@pytest.mark.parametrize("sender", [(255, 190), (1, 191), (2, 1)])
def test_nobody_but_the_autopilot_is_believed(sender):
    bench = Bench().held()
    other = by_name("HEARTBEAT").make((0, 6, 8 if sender[0] != 2 else 12, 0, 0, 3))
    bench.autopilot.on_message(Message("HEARTBEAT", *sender, 0, other), bench.now_s)
    bench.authority.on_mode(bench.now_s)
    assert bench.control is Control.HELD
    assert bench.autopilot.strangers == ({2} if sender[0] == 2 else set())
