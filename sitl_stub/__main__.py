"""`python -m sitl_stub`: a PX4-like vehicle with a ranging radio on UDP ports of this machine."""

from __future__ import annotations

import argparse
import hashlib
import math
import signal
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

from sitl_stub import __version__
from sitl_stub.config import AIRFRAMES, RANGE_MESSAGES, StubConfig
from sitl_stub.devices import DEVICES
from sitl_stub.faults import FAULTS
from sitl_stub.server import Endpoint, PortBusy, Pty, Server, TruthLog
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
        pty = Pty() if arguments.device and not arguments.device_port else None
        server = Server(stub, _endpoints(arguments), arguments.speed, truth, pty)
    except PortBusy as error:
        print(f"sitl_stub: {error}", file=sys.stderr)
        return 3
    except OSError as error:
        print(f"sitl_stub: cannot write {arguments.truth}: {error.strerror}", file=sys.stderr)
        return 3
    stopped = _stop_on_signals()
    places = ", ".join(f"{link} {server.port(link)} -> {e.peer_port}" for link, e in _endpoints(arguments).items())
    device = f", {config.device} on {pty.name}" if pty is not None else ""
    who = f"{config.airframe}, system {config.system_id}"
    print(f"sitl_stub {__version__} ready: {who}, UDP {places}{device}", flush=True)
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
    if a.device and a.device_port:
        endpoints["device"] = Endpoint(0, a.device_port)
    return endpoints


def _fault_lines(a: argparse.Namespace) -> tuple[str, ...]:
    lines = list(a.fault)
    if a.faults:
        try:
            text = Path(a.faults).read_text(encoding="utf-8")
        except OSError as error:
            raise ValueError(f"cannot read {a.faults}: {error.strerror}") from error
        lines += [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    return tuple(lines)


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
        range_max_m=a.max_range,
        range_step_m=a.range_step,
        ready_after_s=a.ready_after,
        range_link="ranging" if a.ranging_port else "offboard",
        range_message=a.range_message,
        range_sysid=a.range_from[0] if a.range_from else None,
        range_compid=a.range_from[1] if a.range_from else 158,
        range_sensor_id=a.sensor_id,
        range_orientation=a.orientation,
        range_beacon_id=a.beacon_id,
        device=a.device,
        compass_error_rad=math.radians(a.compass_error),
        airspeed_scale=a.airspeed_scale,
        gps=not a.no_gps,
        mavlink_version=a.mavlink,
        signing_key=hashlib.sha256(a.sign.encode()).digest() if a.sign else b"",
        faults=_fault_lines(a),
    )


def _fault_help() -> str:
    lines = [f"  {'FROM-TO' if lasts else 'AT'} {kind} {usage}" for kind, (lasts, _, usage, _) in FAULTS.items()]
    width = max(map(len, lines)) + 2
    meant = [meaning for _, _, _, meaning in FAULTS.values()]
    return "\nfaults, times in flight seconds:\n" + "\n".join(
        f"{line:<{width}}{meaning}" for line, meaning in zip(lines, meant, strict=True)
    )


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """Say in one line what is wrong."""
        self.exit(2, f"sitl_stub: {message} (python -m sitl_stub --help lists every option)\n")


def _parser() -> argparse.ArgumentParser:
    p = _Parser(
        prog="python -m sitl_stub",
        description=__doc__,
        epilog=EPILOG + _fault_help(),
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
    add(
        "--ready-after",
        type=float,
        default=1.0,
        metavar="S",
        help="arming is refused until then (1; a real PX4: 6 to 8)",
    )
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
    add("--max-range", type=_positive, default=650.0, metavar="M", help="the radio is silent beyond it (650)")
    add("--range-step", type=float, default=0.0, metavar="M", help="ranges come in steps of so much (0: as they are)")
    add("--range-message", choices=RANGE_MESSAGES, default="distance_sensor", help="what carries ranges")
    add("--range-from", type=_ids, metavar="SYS,COMP", help="who sends ranges (the vehicle's system, component 158)")
    add("--sensor-id", type=int, default=7, metavar="ID", help="of DISTANCE_SENSOR (7)")
    add("--orientation", type=int, default=0, metavar="N", help="of DISTANCE_SENSOR (0)")
    add("--beacon-id", type=int, default=1, metavar="ID", help="of RANGING_BEACON, LANDING_TARGET, devices (1)")
    add("--device", choices=sorted(DEVICES), default="", help="send a device's own bytes instead of messages, on a")
    add("--device-port", type=_port, default=0, metavar="PORT", help="UDP port, or without it on a pseudo-terminal")
    add("--compass-error", type=float, default=0.0, metavar="DEG", help="what the compass shows too much, clockwise")
    add("--airspeed-scale", type=_positive, default=1.0, metavar="K", help="airspeed shown / calibrated airspeed")
    add("--no-gps", action="store_true", help="no position estimate")
    add("--mavlink", type=int, choices=(1, 2), default=2, help="1: speak MAVLink 1 until the peer speaks 2")
    add("--sign", metavar="PASSPHRASE", help="sign MAVLink 2 with the SHA-256 of this, and take only signed frames")
    add("--fault", action="append", default=[], metavar="LINE", help="'FROM-TO KIND ...' or 'AT KIND ...', see below")
    add("--faults", metavar="FILE", help="a file of such lines")
    add("--no-radio", action="store_true", help="no ranging radio on board")
    add("--offboard-port", type=_port, default=14540, metavar="PORT", help="the companion's port (14540)")
    add("--offboard-listen", type=_port, default=14580, metavar="PORT", help="the vehicle's port for it (14580)")
    add("--gcs-port", type=_port, default=14550, metavar="PORT", help="the ground station's port (14550)")
    add("--gcs-listen", type=_port, default=18570, metavar="PORT", help="the vehicle's port for it (18570)")
    add("--ranging-port", type=_port, default=0, metavar="PORT", help="send ranges here, not on the vehicle's link")
    return p


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


if __name__ == "__main__":
    sys.exit(main())
