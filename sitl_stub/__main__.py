"""`python -m sitl_stub`: a PX4-like vehicle with a ranging radio on UDP ports of this machine."""

from __future__ import annotations

import argparse
import math
import signal
import sys
from collections.abc import Callable
from pathlib import Path

from sitl_stub import __version__
from sitl_stub.config import AIRFRAMES, StubConfig
from sitl_stub.server import Endpoint, PortBusy, Server, TruthLog
from sitl_stub.stub import Stub

EPILOG = """\
The offboard link sends to --offboard-port (as PX4 to 14540) and answers whoever speaks on --offboard-listen (14580);
the gcs link likewise (14550, 18570). Connect an app to udpin://0.0.0.0:14540, a ground station to UDP 14550.

Distances are metres, east and north count from the world's origin, times are flight seconds since boot. The truth
file is CSV with a header line: t_s, east_m, north_m, height_m, heading_rad (counter-clockwise from east), course_rad,
speed_m_s, climb_m_s, airspeed_m_s, turn_rate_rad_s (+ counter-clockwise), roll_rad, pitch_rad, the beacon's place,
range_m (slant), horizontal_range_m, the wind, mode, armed, failsafe; 20 rows per flight second.

example: python -m sitl_stub --beacon 120,80 --start 0,0 --wind 3,0 --outliers 0.1 --truth truth.csv --speed 5
exit codes: 0 ended as asked (duration over, Ctrl-C, SIGTERM); 2 wrong arguments; 3 a busy port or an unwritable file
"""


def main(argv: list[str] | None = None) -> int:
    """Run the stub until it is stopped; return the exit code."""
    arguments = _parser().parse_args(argv)
    try:
        config = _config(arguments)
        stub = Stub(config)
    except ValueError as error:
        print(f"sitl_stub: {error}", file=sys.stderr)
        return 2
    try:
        truth = TruthLog(Path(arguments.truth)) if arguments.truth else None
        server = Server(stub, _endpoints(arguments), arguments.speed, truth)
    except PortBusy as error:
        print(f"sitl_stub: {error}", file=sys.stderr)
        return 3
    except OSError as error:
        print(f"sitl_stub: cannot write {arguments.truth}: {error.strerror}", file=sys.stderr)
        return 3
    stopped = _stop_on_signals()
    places = ", ".join(f"{link} {server.port(link)} -> {e.peer_port}" for link, e in _endpoints(arguments).items())
    print(f"sitl_stub {__version__} ready: {config.airframe}, system {config.system_id}, UDP {places}", flush=True)
    try:
        server.run(arguments.duration, stopped)
    finally:
        server.close()
    return 0


def _stop_on_signals() -> Callable[[], bool]:
    seen: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda signum, _: seen.append(signum))
    return lambda: bool(seen)


def _endpoints(a: argparse.Namespace) -> dict[str, Endpoint]:
    endpoints = {
        "offboard": Endpoint(a.offboard_listen, a.offboard_port),
        "gcs": Endpoint(a.gcs_listen, a.gcs_port),
    }
    if a.ranging_port:
        endpoints["ranging"] = Endpoint(0, a.ranging_port)
    return endpoints


def _config(a: argparse.Namespace) -> StubConfig:
    return StubConfig(
        seed=a.seed,
        airframe=a.airframe,
        system_id=a.system_id,
        params=dict(a.param),
        start_east_m=a.start[0],
        start_north_m=a.start[1],
        start_heading_rad=math.pi / 2 - math.radians(a.heading),
        start_height_m=a.airborne,
        start_speed_m_s=a.start_speed,
        beacon_east_m=a.beacon[0],
        beacon_north_m=a.beacon[1],
        beacon_height_m=a.beacon[2] if len(a.beacon) == 3 else 0.0,
        beacon_east_m_s=a.beacon_velocity[0],
        beacon_north_m_s=a.beacon_velocity[1],
        wind_east_m_s=a.wind[0],
        wind_north_m_s=a.wind[1],
        gust_sigma_m_s=a.gusts,
        radio=not a.no_radio,
        range_sigma_m=a.sigma,
        range_rate_hz=a.rate,
        range_bias_m=a.bias,
        range_latency_s=a.latency,
        range_dropouts_s=tuple(a.dropout),
        outlier_share=a.outliers,
        outlier_mean_m=a.outlier_mean,
        range_link="ranging" if a.ranging_port else "offboard",
    )


def _parser() -> argparse.ArgumentParser:
    p = argparse.ArgumentParser(
        prog="python -m sitl_stub",
        description=__doc__,
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = p.add_argument
    add("--version", action="version", version=f"sitl_stub {__version__}")
    add("--airframe", choices=AIRFRAMES, default="multirotor")
    add("--speed", type=_positive, default=1.0, metavar="N", help="flight seconds per wall second (1)")
    add("--seed", type=int, default=1, help="of every random draw (1)")
    add("--duration", type=_positive, metavar="S", help="stop after so many flight seconds")
    add("--truth", metavar="FILE", help="write the ground truth as CSV")
    add("--param", type=_assignment, action="append", default=[], metavar="NAME=VALUE", help="set a PX4 parameter")
    add("--system-id", type=int, default=1, metavar="ID", help="MAVLink system id (1)")
    add("--start", type=_numbers(2), default=(0.0, 0.0), metavar="E,N", help="where it stands at the start")
    add("--heading", type=float, default=0.0, metavar="DEG", help="compass heading at the start (0 = north)")
    add("--airborne", type=float, default=0.0, metavar="H", help="start flying in Hold at this height")
    add("--start-speed", type=float, default=0.0, metavar="M_S", help="ground speed of an airborne start")
    add("--beacon", type=_numbers(2, 3), default=(100.0, 60.0), metavar="E,N[,H]", help="the beacon (100,60,0)")
    add("--beacon-velocity", type=_numbers(2), default=(0.0, 0.0), metavar="E,N", help="m/s")
    add("--wind", type=_numbers(2), default=(0.0, 0.0), metavar="E,N", help="the air's velocity, m/s")
    add("--gusts", type=float, default=0.0, metavar="SIGMA", help="standard deviation of gusts, m/s")
    add("--sigma", type=float, default=0.3, metavar="M", help="range noise (0.3)")
    add("--bias", type=float, default=0.0, metavar="M", help="range bias")
    add("--rate", type=_positive, default=10.0, metavar="HZ", help="ranges per second (10)")
    add("--latency", type=float, default=0.0, metavar="S", help="age of a range when it is sent")
    add("--outliers", type=float, default=0.0, metavar="SHARE", help="share of ranges that are too long, 0..1")
    add("--outlier-mean", type=float, default=10.0, metavar="M", help="mean of the excess (10)")
    add("--dropout", type=_window, action="append", default=[], metavar="A:B", help="no ranges from A to B")
    add("--no-radio", action="store_true", help="no ranging radio on board")
    add("--offboard-port", type=int, default=14540, metavar="PORT", help="the companion's port (14540)")
    add("--offboard-listen", type=int, default=14580, metavar="PORT", help="the vehicle's port for it (14580)")
    add("--gcs-port", type=int, default=14550, metavar="PORT", help="the ground station's port (14550)")
    add("--gcs-listen", type=int, default=18570, metavar="PORT", help="the vehicle's port for it (18570)")
    add("--ranging-port", type=int, default=0, metavar="PORT", help="send ranges here, not on the vehicle's link")
    return p


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value


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


if __name__ == "__main__":
    sys.exit(main())
