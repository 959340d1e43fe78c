"""`circumnav demo`: the bundled vehicle stub in a process of its own, and the app, over UDP on loopback."""

from __future__ import annotations

import math
import random
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from circumnav_mav.config import Config, ConfigError, Fault, Ranging
from circumnav_mav.mavlink.px4_modes import WORDS as PX4
from circumnav_mav.runtime.app import Options
from circumnav_mav.runtime.clock import Clock
from circumnav_mav.runtime.session import Outcome, fly
from circumnav_mav.runtime.transport import LinkError
from circumnav_mav.runtime.view import open_view

CLIMB_M_S = 1.0
STUB_STOP_S = 5.0


@dataclass(frozen=True, slots=True)
class Show:
    """How the stub's airframe is shown. The take-off runs across the line to the beacon."""

    start_m: float  # how far from the beacon it starts
    height_m: float  # flown where the configuration gives none
    laps: float  # settled laps flown before the demo ends


SHOWS = {"multirotor": Show(200.0, 15.0, 2.1), "fixed_wing": Show(400.0, 100.0, 4.1)}
"""By the airframes that the stub has."""


def demo_config(config: Config | None) -> Config:
    """Return what the demo flies: the given configuration, or the defaults, with the link and the hands of the demo.

    Nobody is there to select Offboard, so the demo engages by itself; the vehicle's link is a free port on loopback.
    """
    base = config or Config()
    height_m = base.orbit.height_m or _show(base).height_m
    return base.model_copy(
        update={
            "engage": "auto",
            "vehicle": base.vehicle.model_copy(update={"link": "udpin://127.0.0.1:0"}),
            "orbit": base.orbit.model_copy(update={"height_m": height_m}),
            "ranging": _stub_radio(base.ranging),
        }
    )


def _stub_radio(ranging: Ranging) -> Ranging:
    """Return how the stub's radio is heard, whatever radio the file names: it sends DISTANCE_SENSOR on the vehicle's
    link, and the beacon stands on the ground. What concerns the flight (ages, noise, bias) stays the file's.
    """
    kept = ("max_age_s", "coast_s", "bias_m", "latency_s", "sigma_m", "target_height_m")
    values = {key: getattr(ranging, key) for key in kept}
    values["target_height_m"] = 0.0 if ranging.target_height_m is None else ranging.target_height_m
    return Ranging(**values)


def longest_s(config: Config) -> float:
    """Return when a demo that never settles ends: climb, approach, and four laps."""
    orbit = config.orbit
    lap_s = 2 * math.pi * orbit.radius_m / orbit.speed_m_s
    show = _show(config)
    return 15.0 + (orbit.height_m or 0.0) / CLIMB_M_S + show.start_m / orbit.speed_m_s + (show.laps + 2) * lap_s


def _show(config: Config) -> Show:
    vehicle = config.vehicle_class
    show = SHOWS.get(vehicle.airframe)
    if vehicle.words is not PX4 or show is None:
        text = f"the bundled stub is a PX4 multirotor or airplane and cannot fly {vehicle.name}: use its own simulator"
        raise ConfigError("demo", [Fault("vehicle.class", 0, text)])
    return show


def run_demo(config: Config, *, speed: float, seed: int, duration_s: float | None, stub_args: list[str]) -> Outcome:
    """Fly the demo and return its outcome. Raises LinkError where the stub does not start."""
    orbit, show = config.orbit, _show(config)
    lap_s = 2 * math.pi * orbit.radius_m / orbit.speed_m_s
    options = Options(
        duration_s=longest_s(config) if duration_s is None else duration_s,
        wait_s=30.0 * max(1.0, speed),
        end_on_release=True,
        end_after_orbiting_s=math.inf if duration_s is not None else show.laps * lap_s,
    )
    stub: list[subprocess.Popen[bytes]] = []
    parent = Path(config.record.directory)
    parent.mkdir(parents=True, exist_ok=True)
    truth = parent / f".truth-{random.SystemRandom().getrandbits(32):08x}.csv"
    bearing = random.Random(seed).uniform(0.0, 2 * math.pi)
    beacon = f"{show.start_m * math.cos(bearing):.3f},{show.start_m * math.sin(bearing):.3f}"

    def start_stub(port: int) -> None:
        command = [sys.executable, "-m", "sitl_stub", "--offboard-port", str(port), "--offboard-listen", "0"]
        command += [
            "--gcs-port",
            "0",
            "--gcs-listen",
            "0",
            "--speed",
            f"{speed:g}",
            "--seed",
            str(seed),
            "--beacon=" + beacon,
            f"--heading={-math.degrees(bearing) % 360.0:.3f}",
            f"--airframe={config.vehicle_class.airframe}",
        ]
        command += ["--sigma", f"{config.ranging.sigma_m:g}", "--truth", str(truth), *stub_args]
        stub.append(subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL))

    def stop_stub() -> None:
        for child in stub:
            child.terminate()
            try:
                child.wait(STUB_STOP_S)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()

    view = open_view(f"circumnav demo  {orbit.radius_m:g} m at {orbit.speed_m_s:g} m/s, {speed:g} x real time")
    title = f"circumnav demo: {orbit.radius_m:g} m {orbit.direction} at {orbit.speed_m_s:g} m/s, seed {seed}"
    try:
        outcome = fly(
            config,
            Clock(speed),
            view,
            options,
            title=title,
            truth_file=truth,
            on_open=start_stub,
            before_report=stop_stub,
        )
    finally:
        kept = truth.exists()
    if kept and outcome.directory is not None:
        truth.rename(outcome.directory / "truth.csv")
    if stub and stub[0].returncode not in (0, None) and outcome.result.outcome == "no_autopilot":
        raise LinkError(f"the vehicle stub did not start (exit code {stub[0].returncode})")
    return outcome
