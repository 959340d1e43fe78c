"""`circumnav demo`: the bundled vehicle stub in a process of its own, and the app, over UDP on loopback."""

from __future__ import annotations

import math
import random
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from circumnav_mav.config import Config, Ranging
from circumnav_mav.config_file import ConfigError, Fault
from circumnav_mav.mavlink.px4_modes import WORDS as PX4
from circumnav_mav.runtime.app import Options
from circumnav_mav.runtime.pace import PacedClock
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


def demo_note(config: Config | None) -> str:
    """Return what the demo flies otherwise than the file says (or the defaults, without one); empty for nothing."""
    if (config or Config()).ranging.target_height_m is not None:
        return ""
    return "ranging.target_height_m is null, and the stub's beacon is on the ground: the demo flew with 0"


def _stub_radio(ranging: Ranging) -> Ranging:
    """Return how the stub's radio is heard, whatever radio the file names: it sends DISTANCE_SENSOR on the vehicle's
    link, and the beacon stands on the ground. What concerns the flight (ages, noise, bias) stays the file's.
    """
    kept = ("max_age_s", "coast_s", "bias_m", "latency_s", "sigma_m", "target_height_m")
    values = {key: getattr(ranging, key) for key in kept}
    values["target_height_m"] = 0.0 if ranging.target_height_m is None else ranging.target_height_m
    return Ranging(**values)


def demo_speed(config: Config) -> float:
    """Return how many times real time a demo flies: MAVSDK's process keeps the wall's time, and nobody waits for it."""
    return 1.0 if config.vehicle.library == "mavsdk" else 5.0


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


class _Stub:
    """The vehicle stub as a process; its truth file and its complaints lie in `directory`."""

    def __init__(self, arguments: list[str], directory: Path) -> None:
        self.truth, self.pace = directory / "truth.csv", directory / "pace"
        self._arguments = [f"--truth={self.truth}", f"--pace={self.pace}", *arguments]
        self._complaints = directory / "complaints.txt"
        self._child: subprocess.Popen[bytes] | None = None

    def start(self, port: int) -> None:
        command = [sys.executable, "-m", "sitl_stub", "--offboard-port", str(port), *self._arguments]
        with self._complaints.open("wb") as complaints:  # a file: nobody need read it while the stub runs
            self._child = subprocess.Popen(
                command, start_new_session=True, stdout=subprocess.DEVNULL, stderr=complaints
            )

    def gone(self) -> str:
        """Return why the stub has ended, in its own last words; empty while it runs."""
        if self._child is None or (code := self._child.poll()) is None:
            return ""
        said = self._complaints.read_text(errors="replace").strip().splitlines()
        return f"the vehicle stub ended (exit code {code})" + (f": {said[-1]}" if said else "")

    def stop(self) -> None:
        if self._child is None:
            return
        self._child.terminate()
        try:
            self._child.wait(STUB_STOP_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()


def run_demo(config: Config, *, speed: float, seed: int, duration_s: float | None, stub_args: list[str]) -> Outcome:
    """Fly the demo and return its outcome. Raises LinkError where the stub does not start."""
    with tempfile.TemporaryDirectory(prefix="circumnav-") as directory:
        stub = _Stub(_stub_arguments(config, speed, seed) + stub_args, Path(directory))
        outcome = _fly(config, stub, speed, seed, duration_s)
        if outcome.directory is not None and stub.truth.exists():
            try:
                shutil.move(stub.truth, outcome.directory / "truth.csv")
            except OSError as error:
                outcome.notes.append(f"no truth.csv: {error.strerror or error}")
    return outcome


def _stub_arguments(config: Config, speed: float, seed: int) -> list[str]:
    start_m, bearing = _show(config).start_m, random.Random(seed).uniform(0.0, 2 * math.pi)
    return [
        "--offboard-listen=0",
        "--gcs-port=0",
        "--gcs-listen=0",
        f"--speed={speed:g}",
        f"--seed={seed}",
        f"--beacon={start_m * math.cos(bearing):.3f},{start_m * math.sin(bearing):.3f}",
        f"--heading={-math.degrees(bearing) % 360.0:.3f}",
        f"--airframe={config.vehicle_class.airframe}",
        f"--sigma={config.ranging.sigma_m:g}",
    ]


def _fly(config: Config, stub: _Stub, speed: float, seed: int, duration_s: float | None) -> Outcome:
    orbit = config.orbit
    lap_s = 2 * math.pi * orbit.radius_m / orbit.speed_m_s
    options = Options(
        duration_s=longest_s(config) if duration_s is None else duration_s,
        wait_s=30.0 * max(1.0, speed),
        end_on_release=True,
        end_after_orbiting_s=math.inf if duration_s is not None else _show(config).laps * lap_s,
        gone=stub.gone,
    )
    end: list[str] = []

    def stop_stub() -> None:
        end.append(stub.gone())
        stub.stop()

    outcome = fly(
        config,
        PacedClock(speed, stub.pace),
        open_view(f"circumnav demo  {orbit.radius_m:g} m at {orbit.speed_m_s:g} m/s, {speed:g} x real time"),
        options,
        title=f"circumnav demo: {orbit.radius_m:g} m {orbit.direction} at {orbit.speed_m_s:g} m/s, seed {seed}",
        truth_file=stub.truth,
        on_open=stub.start,
        before_report=stop_stub,
    )
    if outcome.result.outcome == "no_autopilot" and not outcome.result.engaged_s < math.inf and any(end):
        raise LinkError(end[0])
    return outcome
