"""The options of `python -m sitl_stub`, and its help."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import NoReturn

from sitl_stub import __version__
from sitl_stub.config import AIRFRAMES, RANGE_MESSAGES
from sitl_stub.devices import DEVICES
from sitl_stub.faults import FAULTS

DESCRIPTION = """\
A vehicle that speaks MAVLink as PX4 v1.16 does, with a radio that ranges to a beacon, for testing companion apps
without hardware. It stands on the ground and waits to be armed, or hovers with --airborne. Start it, then connect an
app to udpin://0.0.0.0:14540 and a ground station to UDP 14550; Ctrl-C ends it.

  python -m sitl_stub                                         a quadrotor on the ground, a beacon 117 m away
  python -m sitl_stub --airborne 30 --beacon 120,80           flying already, so that an app may take over at once
  python -m sitl_stub --airframe fixed_wing --airborne 100 --wind 4,0 --gusts 1
  python -m sitl_stub --airborne 30 --fault "60-75 range-stop" --truth truth.csv --speed 5 --duration 300
"""
EPILOG = """\
Lengths are metres, east and north count from the world's origin, times are flight seconds since boot. Every option is
a field of sitl_stub.StubConfig too, which has a few more. docs/stub.md tells how to fly it inside a test.

--truth writes CSV with a header line, 20 rows a flight second: t_s, east_m, north_m, height_m, heading_rad
(counter-clockwise from east), course_rad, speed_m_s, climb_m_s, airspeed_m_s, turn_rate_rad_s (+ counter-clockwise),
roll_rad, pitch_rad, the beacon's place, range_m (slant), horizontal_range_m, the wind, mode, armed, failsafe.

exit codes: 0 ended as asked (duration over, Ctrl-C, SIGTERM); 2 wrong arguments; 3 a busy port or an unwritable file
"""


def _fault_help() -> str:
    lines = [f"  {'FROM-TO' if lasts else 'AT'} {kind} {usage}" for kind, (lasts, _, usage, _) in FAULTS.items()]
    width = max(map(len, lines)) + 2
    meant = [meaning for _, _, _, meaning in FAULTS.values()]
    return (
        "\nfaults, times in flight seconds (TO may be inf); lines of one kind may overlap, each ends by itself:\n"
        + "\n".join(f"{line:<{width}}{meaning}" for line, meaning in zip(lines, meant, strict=True))
    )


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """Say in one line what is wrong."""
        self.exit(2, f"sitl_stub: {message} (python -m sitl_stub --help lists every option)\n")


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    p = _Parser(
        prog="python -m sitl_stub",
        usage="python -m sitl_stub [options]",
        description=DESCRIPTION,
        epilog=EPILOG + _fault_help(),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("--version", action="version", version=f"sitl_stub {__version__}")
    _add_running(p.add_argument_group("running").add_argument)
    _add_vehicle(p.add_argument_group("the vehicle").add_argument)
    _add_world(p.add_argument_group("the world").add_argument)
    _add_radio(p.add_argument_group("the ranging radio").add_argument)
    _add_links(p.add_argument_group("links: each sends to a peer's port and answers whoever speaks").add_argument)
    return p


Add = Callable[..., argparse.Action]


def _add_running(add: Add) -> None:
    add("--speed", type=_positive, default=1.0, metavar="N", help="flight seconds per wall second (1)")
    add("--pace", metavar="FILE", help="keep one clock with a companion through this file (see docs/stub.md)")
    add("--seed", type=int, default=1, metavar="N", help="of every random draw (1)")
    add("--duration", type=_positive, metavar="S", help="stop after so many flight seconds")
    add("--truth", metavar="FILE", help="write the ground truth as CSV")
    add("--fault", action="append", default=[], metavar="LINE", help="'FROM-TO KIND ...' or 'AT KIND ...', see below")
    add("--faults", metavar="FILE", help="a file of such lines")


def _add_vehicle(add: Add) -> None:
    add("--airframe", choices=AIRFRAMES, default="multirotor", help="(multirotor)")
    add("--airborne", type=float, default=0.0, metavar="H", help="start armed and flying in Hold at this height")
    add("--start", type=_numbers(2), default=(0.0, 0.0), metavar="E,N", help="where it is at the start (0,0)")
    add("--start-speed", type=float, default=0.0, metavar="M_S", help="ground speed of an airborne start")
    add("--heading", type=float, default=0.0, metavar="DEG", help="compass heading at the start (0 = north)")
    add("--ready-after", type=float, default=1.0, metavar="S", help="arming is refused until then (1; a real PX4: 6-8)")
    add("--param", type=_assignment, action="append", default=[], metavar="NAME=VALUE", help="set a PX4 parameter")
    add("--system-id", type=int, default=1, metavar="ID", help="MAVLink system id (1)")
    add("--compass-error", type=float, default=0.0, metavar="DEG", help="what the compass shows too much, clockwise")
    add("--airspeed-scale", type=_positive, default=1.0, metavar="K", help="airspeed shown / calibrated airspeed (1)")
    add("--no-gps", action="store_true", help="no position estimate")


def _add_world(add: Add) -> None:
    add("--beacon", type=_numbers(2, 3), default=(100.0, 60.0), metavar="E,N[,H]", help="the beacon (100,60,0)")
    add("--beacon-velocity", type=_numbers(2), default=(0.0, 0.0), metavar="E,N", help="m/s; the beacon may move")
    add("--wind", type=_numbers(2), default=(0.0, 0.0), metavar="E,N", help="where the air moves to, m/s")
    add("--gusts", type=float, default=0.0, metavar="SIGMA", help="standard deviation of gusts, m/s")


def _add_radio(add: Add) -> None:
    add("--no-radio", action="store_true", help="there is none on board")
    add("--rate", type=_positive, default=10.0, metavar="HZ", help="ranges per second (10)")
    add("--sigma", type=float, default=0.3, metavar="M", help="noise (0.3)")
    add("--bias", type=float, default=0.0, metavar="M", help="what every range is too long")
    add("--range-step", type=float, default=0.0, metavar="M", help="ranges come in steps of so much (0: as they are)")
    add("--latency", type=float, default=0.0, metavar="S", help="age of a range when it is sent")
    add("--outliers", type=float, default=0.0, metavar="SHARE", help="share of ranges that took a detour, 0..1")
    add("--outlier-mean", type=float, default=10.0, metavar="M", help="mean detour (10)")
    add("--dropout", type=_window, action="append", default=[], metavar="A:B", help="no ranges from A to B")
    add("--max-range", type=_positive, default=650.0, metavar="M", help="silent beyond it (650)")
    messages = ", ".join(RANGE_MESSAGES)
    add("--range-message", choices=RANGE_MESSAGES, default="distance_sensor", metavar="NAME", help=f"one of {messages}")
    add("--range-from", type=_ids, metavar="SYS,COMP", help="who sends them (the vehicle's system, component 158)")
    add("--sensor-id", type=int, default=7, metavar="ID", help="of DISTANCE_SENSOR (7)")
    add("--orientation", type=int, default=0, metavar="N", help="of DISTANCE_SENSOR (0)")
    add("--beacon-id", type=int, default=1, metavar="ID", help="of RANGING_BEACON, LANDING_TARGET, devices (1)")
    add("--ranging-port", type=_port, default=0, metavar="PORT", help="UDP port for the messages: a link of their own")
    device = f"no messages but a device's bytes, on a pseudo-terminal that the ready line names: {', '.join(DEVICES)}"
    add("--device", choices=sorted(DEVICES), default="", metavar="NAME", help=device)
    add("--device-port", type=_port, default=0, metavar="PORT", help="UDP port for these bytes, and no pseudo-terminal")


def _add_links(add: Add) -> None:
    add("--offboard-port", type=_port, default=14540, metavar="PORT", help="the companion's port (14540)")
    add(
        "--offboard-listen", type=_port, default=14580, metavar="PORT", help="the vehicle's port for it (14580; 0: any)"
    )
    add("--gcs-port", type=_port, default=14550, metavar="PORT", help="the ground station's port (14550)")
    add("--gcs-listen", type=_port, default=18570, metavar="PORT", help="the vehicle's port for it (18570; 0: any)")
    add("--mavlink", type=int, choices=(1, 2), default=2, help="1: speak MAVLink 1 until the peer speaks 2")
    add("--sign", metavar="PASSPHRASE", help="sign with the SHA-256 of this, and take only signed frames")


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value


def _port(text: str) -> int:
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text!r} is not a UDP port: 0 to 65535")
    return int(text)


def _numbers(*counts: int) -> Callable[[str], tuple[float, ...]]:
    def parse(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(part) for part in text.split(","))
        except ValueError:
            values = ()
        if len(values) not in counts or not all(math.isfinite(v) for v in values):
            wanted = " or ".join(map(str, counts))
            raise argparse.ArgumentTypeError(f"{text!r} is not {wanted} numbers with commas between them")
        return values

    return parse


def _ids(text: str) -> tuple[int, int]:
    try:
        system, component = (int(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not SYSTEM,COMPONENT") from None
    return system, component


def _window(text: str) -> tuple[float, float]:
    begin, _, end = text.partition(":")
    try:
        return float(begin), float(end)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not FROM:TO in seconds") from None


def _assignment(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not NAME=VALUE") from None
