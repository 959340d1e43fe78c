"""`python -m sitl_stub`: a PX4-like vehicle with a ranging radio on UDP ports of this machine."""

from __future__ import annotations

import argparse
import math
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path

from sitl_stub import __version__
from sitl_stub.combinations import given, idle
from sitl_stub.config import StubConfig
from sitl_stub.options import parser
from sitl_stub.pace import Pace
from sitl_stub.server import Endpoint, Pty, Server, TruthLog
from sitl_stub.signing import key_of
from sitl_stub.stub import Stub


def main(argv: list[str] | None = None) -> int:
    """Run the stub until it is stopped; return the exit code."""
    options = parser()
    arguments = options.parse_args(argv)
    for line in idle(arguments, given(options, argv)):
        options.error(line)
    try:
        config = _config(arguments)
        stub = Stub(config)
        pace = _pace(arguments.pace)
    except ValueError as error:
        print(f"sitl_stub: {error}", file=sys.stderr)
        return 2
    try:
        truth = TruthLog(Path(arguments.truth)) if arguments.truth else None
        pty = Pty() if arguments.device and not arguments.device_port else None
        server = Server(stub, _endpoints(arguments), arguments.speed, truth, pty, pace)
    except OSError as error:
        return _say(error)
    stopped = _stop_on_signals()
    places = ", ".join(f"{link} {server.port(link)} -> {e.peer_port}" for link, e in _endpoints(arguments).items())
    device = f", {config.device} on {pty.name}" if pty is not None else ""
    who = f"{config.airframe}, system {config.system_id}"
    print(f"sitl_stub {__version__} ready: {who}, UDP {places}{device}", flush=True)
    try:
        try:
            server.run(arguments.duration, stopped)
        finally:
            server.close()  # a full disk may show only now
    except OSError as error:
        return _say(error)
    return 0


def _pace(name: str | None) -> Pace | None:
    try:
        return Pace(Path(name)) if name else None
    except OSError as error:
        raise ValueError(f"cannot use --pace {name}: {error.strerror}") from error


def _say(error: OSError) -> int:
    what = f"cannot write {error.filename}: {error.strerror}" if error.filename else str(error)
    print(f"sitl_stub: {what}", file=sys.stderr)
    return 3


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
        unix_start_s=time.time(),
        signing_key=key_of(a.sign),
        faults=_fault_lines(a),
    )


if __name__ == "__main__":
    sys.exit(main())
