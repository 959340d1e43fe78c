"""What the companion sent to the real PX4 is sent to the stub again, and what both showed is compared, row by row.

`python -m tests.stub.conformance > docs/conformance.md` writes the report that docs/ keeps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

from sitl_stub import Stub, StubConfig, wire
from tests.stub.capture import CAPTURES, Flight, Watcher, load

SIM_RATE = 0.9755  # the simulated PX4 ran this much slower than the wall clock that stamped its captures
BOOTED_S = 8.75  # flight time when the captures begin
MODE_S, SHOWN_S = 0.2, 1.0  # a change of mode, and where only the next HEARTBEAT shows it
LANDED_S = MODE_S + 0.1  # and half a period of EXTENDED_SYS_STATE, whose phase is another in the stub
Row = list[float]


@dataclass(frozen=True, slots=True)
class Compared:
    """One row of the report; `within` is the tolerance in words."""

    capture: str
    what: str
    px4: str
    stub: str
    within: str
    ok: bool


@cache
def replay(name: str) -> Watcher:
    """Send a capture's companion frames to the stub at their times, and watch."""
    flight = load(name)
    airframe = "multirotor" if name == "quadx" else "fixed_wing"
    stub = Stub(StubConfig(airframe=airframe, system_id=flight.system_id, radio=False))
    stub.advance(BOOTED_S)
    stub.take("offboard")
    watcher, splitter = Watcher(name, flight.system_id), wire.Splitter()
    todo = iter([*flight.sent, (180.0, b"")])
    at_s, raw = next(todo)
    for tick in range(18000):
        now_s = tick * 0.01
        while at_s <= now_s and raw:
            stub.receive("offboard", raw)
            at_s, raw = next(todo)
        stub.advance(BOOTED_S + SIM_RATE * now_s)
        for datagram in stub.take("offboard"):
            for frame in splitter.feed(datagram):
                watcher.frame(now_s, frame)
    return watcher


def compare(name: str) -> list[Compared]:
    """Return every row of one capture."""
    flight, watcher = load(name), replay(name)
    rows = [*_modes(flight, watcher), *_landed(flight, watcher), *_acks(flight, watcher), *_texts(flight, watcher)]
    rows += _rates(flight, watcher)
    sensors = [" ".join(side.sensors) for side in (flight, watcher)]
    rows.append(Compared(name, "SYS_STATUS (present/enabled/health)", *sensors, "the same", sensors[0] == sensors[1]))
    return rows + (_quadx(flight, watcher) if name == "quadx" else _airplane(flight, watcher))


# -- modes, acknowledgements, texts, streams -----------------------------------------------------------------------


def changes(heartbeats: list[list[float]]) -> list[list[float]]:
    """Return the heartbeats that show something new."""
    return [b for a, b in zip([[0.0], *heartbeats], heartbeats, strict=False) if a[1:] != b[1:]]


def _modes(flight: Flight, watcher: Watcher) -> list[Compared]:
    real, ours = changes(flight.heartbeats), changes(watcher.heartbeats)
    shown = [" ".join(f"{int(h[1]):08x}/{int(h[2])}/{int(h[3])}" for h in side) for side in (real, ours)]
    same = [h[1:] for h in real] == [h[1:] for h in ours]
    rows = [Compared(flight.name, "modes (custom_mode/base_mode/status)", *shown, "the same", same)]
    if same:
        for a, b in zip(real[1:], ours[1:], strict=True):
            what = f"HEARTBEAT shows {int(a[1]):08x}/{int(a[2])}"
            rows.append(_number(flight.name, what, "s", a[0], b[0], absolute=SHOWN_S))
    return rows


TAKING_OFF, IN_AIR = 3, 2


def _landed(flight: Flight, watcher: Watcher) -> list[Compared]:
    """EXTENDED_SYS_STATE comes five times a second: it tells the end of a take-off better than HEARTBEAT does."""
    rows = []
    for state, what in ((TAKING_OFF, "the take-off begins"), (IN_AIR, "the take-off is over")):
        times = [next((t for t, s in side.landed if s == state), math.nan) for side in (flight, watcher)]
        rows.append(_number(flight.name, f"{what} (landed_state {state})", "s", *times, absolute=LANDED_S))
    return rows


def _acks(flight: Flight, watcher: Watcher) -> list[Compared]:
    shown = [" ".join(f"{int(a[1])}:{int(a[2])}" for a in side) for side in (flight.acks, watcher.acks)]
    rows = [Compared(flight.name, "COMMAND_ACK (command:result)", *shown, "the same", shown[0] == shown[1])]
    if shown[0] == shown[1]:
        off = max((abs(a[0] - b[0]), a[0], b[0]) for a, b in zip(flight.acks, watcher.acks, strict=True))
        rows.append(_number(flight.name, "the ACK that differs most in time", "s", off[1], off[2], absolute=0.05))
    return rows


def _texts(flight: Flight, watcher: Watcher) -> list[Compared]:
    def words(texts: list[tuple[float, str]]) -> list[str]:
        joined = "".join(text for _, text in texts).replace("\t", "|")
        return ["RTL: start return" if t.startswith("RTL: start return") else t for t in joined.split("|") if t]

    shown = [", ".join(words(t)) or "none" for t in (flight.texts, watcher.texts)]
    rows = [Compared(flight.name, "STATUSTEXT", *shown, "the same", shown[0] == shown[1])]
    starts = ("Armed", "Takeoff detected", "Failsafe activated", "RTL")
    for start in starts if flight.texts else ():
        times = [
            next((t for t, text in side if text.startswith(start)), math.nan) for side in (flight.texts, watcher.texts)
        ]
        rows.append(_number(flight.name, f"'{start} ...' is said", "s", *times, absolute=MODE_S))
    return rows


# What PX4 sends besides, rarely or on an event, and the stub does not: COMMAND_LONG (a camera's),
# ORBIT_EXECUTION_STATUS and EVENT.
NOT_SENT = {76, 360, 410}


def _rates(flight: Flight, watcher: Watcher) -> list[Compared]:
    rows, ours = [], watcher.rates_hz()
    for msgid in sorted((set(flight.rates_hz) | set(ours)) - NOT_SENT - {77, 253, 22}):
        spec = wire.spec(msgid)
        what = f"{spec.name if spec else msgid} ({msgid})"
        # A few messages in 150 s may be counted in or out at either end.
        sides = (flight.rates_hz.get(msgid, 0.0), ours.get(msgid, 0.0))
        rows.append(_number(flight.name, what, "Hz", *sides, relative=0.05, absolute=0.02))
    return rows


# -- motion --------------------------------------------------------------------------------------------------------


def _quadx(flight: Flight, watcher: Watcher) -> list[Compared]:
    rows = []
    for what, unit, figure, tolerance in (
        ("take-off: climb rate 20-30 s", "m/s", lambda m: _slope(m, 3, 20, 30, -1.0), {"relative": 0.15}),
        ("take-off: climbs 1 m after", "s", lambda m: _climbed(m, 13.0, 1.0), {"relative": 0.15}),
        ("take-off: climbs 5 m after", "s", lambda m: _climbed(m, 13.0, 5.0), {"relative": 0.15}),
        ("take-off: climbs 10 m after", "s", lambda m: _climbed(m, 13.0, 10.0), {"relative": 0.15}),
        ("take-off: climbs 20 m after", "s", lambda m: _climbed(m, 13.0, 20.0), {"relative": 0.15}),
        ("take-off: climbs 29 m after", "s", lambda m: _climbed(m, 13.0, 29.0), {"relative": 0.15}),
        ("height in Hold 40-45 s", "m", lambda m: -_mean(m, 3, 40, 45), {"absolute": 1.0}),
        ("velocity step at 50 s: 50 %", "s", lambda m: _reached(m, 50.0, _speed, 2.5), {"relative": 0.15}),
        ("velocity step at 50 s: 63 %", "s", lambda m: _reached(m, 50.0, _speed, 3.15), {"relative": 0.15}),
        ("velocity step at 50 s: 90 %", "s", lambda m: _reached(m, 50.0, _speed, 4.5), {"relative": 0.15}),
        ("speed 60-108 s", "m/s", lambda m: _average(m, _speed, 60, 108), {"relative": 0.15}),
        ("yaw rate 60-108 s", "rad/s", lambda m: _turn(m, _yaw, 60, 108), {"relative": 0.15}),
        ("course rate 60-108 s", "rad/s", lambda m: _turn(m, _course, 60, 108), {"relative": 0.15}),
        ("sideslip 60-108 s", "deg", lambda m: math.degrees(_average(m, _slip, 60, 108)), {"absolute": 1.5}),
        ("roll 60-108 s", "deg", lambda m: math.degrees(_mean(m, 7, 60, 108)), {"absolute": 1.5}),
        ("pitch 60-108 s", "deg", lambda m: math.degrees(_mean(m, 8, 60, 108)), {"absolute": 2.0}),
        ("yaw rate 113-124 s", "rad/s", lambda m: _turn(m, _yaw, 113, 124), {"relative": 0.15}),
        ("Hold: speed 130-135 s", "m/s", lambda m: _average(m, _speed, 130, 135), {"absolute": 0.3}),
        ("Return: last distance from home", "m", lambda m: math.hypot(*m[-1][1:3]), {"absolute": 2.0}),
        ("Return: last height", "m", lambda m: -m[-1][3], {"absolute": 4.0}),
    ):
        rows.append(_number("quadx", what, unit, figure(flight.motion), figure(watcher.motion), **tolerance))
    return rows


def _airplane(flight: Flight, watcher: Watcher) -> list[Compared]:
    step = math.radians(13.8)
    rows = []
    for what, unit, figure, tolerance in (
        ("take-off: climb rate 20-32 s", "m/s", lambda m: _slope(m, 3, 20, 32, -1.0), {"relative": 0.15}),
        ("take-off: speed 20-32 s", "m/s", lambda m: _average(m, _speed, 20, 32), {"relative": 0.15}),
        ("Hold: yaw rate 45-60 s", "rad/s", lambda m: _turn(m, _yaw, 45, 60), {"relative": 0.15}),
        ("Hold: speed 45-60 s", "m/s", lambda m: _average(m, _speed, 45, 60), {"relative": 0.15}),
        ("Hold: height 45-60 s", "m", lambda m: -_mean(m, 3, 45, 60), {"absolute": 5.0}),
        ("speed level 66-72 s", "m/s", lambda m: _average(m, _speed, 66, 72), {"relative": 0.15}),
        ("roll step at 72 s: 50 %", "s", lambda m: _reached(m, 72.0, _roll, 0.5 * step), {"absolute": 0.04}),
        ("roll step at 72 s: 63 %", "s", lambda m: _reached(m, 72.0, _roll, 0.63 * step), {"relative": 0.15}),
        ("roll step at 72 s: 90 %", "s", lambda m: _reached(m, 72.0, _roll, 0.9 * step), {"relative": 0.15}),
        ("roll 80-120 s", "deg", lambda m: math.degrees(_mean(m, 7, 80, 120)), {"absolute": 0.5}),
        ("yaw rate 80-120 s", "rad/s", lambda m: _turn(m, _yaw, 80, 120), {"relative": 0.15}),
        ("speed 80-120 s", "m/s", lambda m: _average(m, _speed, 80, 120), {"relative": 0.15}),
        ("yaw rate 125-139 s", "rad/s", lambda m: _turn(m, _yaw, 125, 139), {"relative": 0.15}),
        ("height, open loop, 139 s", "m", lambda m: -_mean(m, 3, 138, 140), {"absolute": 15.0}),
        ("POSCTL: yaw rate 145-152 s", "rad/s", lambda m: _turn(m, _yaw, 145, 152), {"absolute": 0.02}),
        ("POSCTL: speed 145-152 s", "m/s", lambda m: _average(m, _speed, 145, 152), {"relative": 0.15}),
    ):
        rows.append(_number("airplane", what, unit, figure(flight.motion), figure(watcher.motion), **tolerance))
    return rows


def _speed(row: Row) -> float:
    return math.hypot(row[4], row[5])


def _course(row: Row) -> float:
    return math.atan2(row[5], row[4])


def _yaw(row: Row) -> float:
    return row[9]


def _roll(row: Row) -> float:
    return row[7]


def _slip(row: Row) -> float:
    return math.remainder(_course(row) - row[9], 2.0 * math.pi)


def _within(motion: list[Row], a: float, b: float) -> list[Row]:
    return [row for row in motion if a <= row[0] <= b]


def _average(motion: list[Row], of, a: float, b: float) -> float:
    rows = _within(motion, a, b)
    return sum(map(of, rows)) / len(rows)


def _mean(motion: list[Row], column: int, a: float, b: float) -> float:
    return _average(motion, lambda row: row[column], a, b)


def _slope(motion: list[Row], column: int, a: float, b: float, sign: float) -> float:
    rows = _within(motion, a, b)
    return sign * (rows[-1][column] - rows[0][column]) / (rows[-1][0] - rows[0][0])


def _turn(motion: list[Row], angle, a: float, b: float) -> float:
    """Return the mean rate of an angle in the vehicle's own time."""
    rows = _within(motion, a, b)
    turned = sum(math.remainder(angle(q) - angle(p), 2.0 * math.pi) for p, q in pairwise(rows))
    return turned / (rows[-1][0] - rows[0][0]) / SIM_RATE


def _reached(motion: list[Row], from_s: float, of, level: float) -> float:
    """Return how long after from_s a figure first passes a level, interpolated between rows; nan if it never does."""
    rows = _within(motion, from_s - 0.1, from_s + 4.0)
    for p, q in pairwise(rows):
        if q[0] > from_s and of(p) < level <= of(q):
            return p[0] + (q[0] - p[0]) * (level - of(p)) / (of(q) - of(p)) - from_s
    return math.nan


def _climbed(motion: list[Row], from_s: float, height_m: float) -> float:
    """Return how long after from_s the vehicle is height_m above where it then was."""
    ground = next(row[3] for row in motion if row[0] >= from_s)
    return next((row[0] - from_s for row in motion if row[0] >= from_s and ground - row[3] >= height_m), math.nan)


def _number(
    capture: str, what: str, unit: str, px4: float, stub: float, relative: float = 0.0, absolute: float = 0.0
) -> Compared:
    ok = abs(stub - px4) <= max(absolute, relative * abs(px4))
    allowed = [f"{100 * relative:.0f} %"] * bool(relative) + [f"{absolute:g} {unit}"] * bool(absolute)
    return Compared(capture, what, f"{px4:.3f} {unit}", f"{stub:.3f} {unit}", " or ".join(allowed), ok)


def report() -> str:
    """Return the report in Markdown."""
    lines = ["| capture | what | PX4 v1.16 | stub | within | |", "|---|---|---|---|---|---|"]
    for name in CAPTURES:
        for r in compare(name):
            lines.append(
                f"| {r.capture} | {r.what} | {r.px4} | {r.stub} | {r.within} | {'yes' if r.ok else '**no**'} |"
            )
    return "\n".join(lines)


if __name__ == "__main__":
    print(report())
