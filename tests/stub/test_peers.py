"""Real peers against the stub: MAVSDK (native asyncio) and MAVProxy. They decide whether the stub passes for a PX4.

One short flight of MAVSDK runs in `make test`, the rest in `make soak`, which brings MAVProxy.
"""

from __future__ import annotations

import asyncio
import math
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any

import pytest

from sitl_stub.running import Vehicle

pytest_plugins = ["sitl_stub.pytest"]
pytestmark = pytest.mark.realtime
mavsdk = pytest.importorskip("mavsdk.asyncio", reason="mavsdk is not installed: its peer tests need it")


@asynccontextmanager
async def connected(vehicle: Vehicle) -> AsyncIterator[Any]:
    """Connect MAVSDK as a companion computer."""
    from mavsdk.asyncio import ComponentType, Configuration, Mavsdk

    configuration = Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER)
    async with Mavsdk(configuration) as sdk:
        await sdk.add_any_connection(vehicle.url)
        system = await sdk.first_autopilot(timeout_s=10.0)
        assert system is not None, "MAVSDK finds no autopilot"
        yield system


async def first(stream: Any, holds: Callable[[Any], bool] = lambda _: True, within_s: float = 20.0) -> Any:
    """Return the first value of a subscription that satisfies `holds`."""

    async def search() -> Any:
        async for value in stream:
            if holds(value):
                return value
        return None

    return await asyncio.wait_for(search(), within_s)


async def flown(vehicle: Vehicle, for_s: float) -> None:
    """Let so much flight time pass, which a machine that stands still holds up."""
    end_s = vehicle.truth().t_s + for_s
    await asyncio.to_thread(vehicle.wait_until, lambda truth: truth.t_s >= end_s, for_s + 1.0)


def fly(story: Callable[[], Awaitable[None]]) -> None:
    asyncio.run(asyncio.wait_for(story(), 120.0))


def test_mavsdk_connects_arms_takes_off_flies_offboard_and_lands(sitl: Any) -> None:
    """At five times the speed; MAVSDK's own 20 Hz are then 4 Hz of flight."""
    from mavsdk.asyncio.plugins.action import ActionAsync
    from mavsdk.asyncio.plugins.offboard import OffboardAsync, VelocityBodyYawspeed
    from mavsdk.asyncio.plugins.telemetry import FlightMode, TelemetryAsync

    vehicle = sitl(params={"COM_OBL_RC_ACT": 5}, speed=5.0, radio=False)

    async def story() -> None:
        async with connected(vehicle) as system:
            action, offboard, telemetry = ActionAsync(system), OffboardAsync(system), TelemetryAsync(system)
            assert await first(telemetry.subscribe_health_all_ok(), lambda ok: ok)
            await action.arm()
            await action.takeoff()
            await first(telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.TAKEOFF)
            await first(telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.HOLD)
            await offboard.set_velocity_body(VelocityBodyYawspeed(3.0, 0.0, 0.0, 0.0))
            await offboard.start()
            await first(telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.OFFBOARD)
            moving = await first(telemetry.subscribe_position_velocity_ned(), lambda p: p.velocity.north_m_s > 2.8)
            assert abs(moving.velocity.east_m_s) < 0.2
            await offboard.stop()
            await action.land()
            await first(telemetry.subscribe_armed(), lambda armed: not armed)

    fly(story)
    truth = vehicle.truth()
    assert (truth.armed, truth.height_m) == (False, 0.0)
    assert truth.north_m > 3.0


@pytest.mark.soak
def test_mavsdk_flies_a_multirotor_from_connection_to_disarming(sitl: Any) -> None:
    from mavsdk.asyncio.plugins.action import ActionAsync
    from mavsdk.asyncio.plugins.offboard import OffboardAsync, VelocityBodyYawspeed
    from mavsdk.asyncio.plugins.telemetry import FlightMode, TelemetryAsync

    vehicle = sitl(params={"COM_OBL_RC_ACT": 5})

    async def story() -> None:
        async with connected(vehicle) as system:
            action, offboard, telemetry = ActionAsync(system), OffboardAsync(system), TelemetryAsync(system)
            assert await first(telemetry.subscribe_health_all_ok(), lambda ok: ok)
            await action.set_takeoff_altitude(5.0)
            assert vehicle.stub.autopilot.params["MIS_TAKEOFF_ALT"] == 5.0
            await action.arm()
            await action.takeoff()
            await first(telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.HOLD)
            position = await first(telemetry.subscribe_position(), lambda p: p.relative_altitude_m > 4.0)
            assert position.relative_altitude_m == pytest.approx(vehicle.truth().height_m, abs=0.5)
            await offboard.set_velocity_body(VelocityBodyYawspeed(0, 0, 0, 0))
            await offboard.start()
            await first(telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.OFFBOARD)
            await offboard.set_velocity_body(VelocityBodyYawspeed(4.0, 0.0, 0.0, math.degrees(0.25)))
            await flown(vehicle, 5.0)
            truth = vehicle.truth()
            assert truth.mode == "OFFBOARD"
            assert truth.speed_m_s == pytest.approx(4.0, abs=0.2)
            assert truth.turn_rate_rad_s == pytest.approx(-0.2445, abs=0.01)
            heading = await first(telemetry.subscribe_heading())
            compass_deg = (90.0 - math.degrees(vehicle.truth().heading_rad)) % 360.0
            assert abs(math.remainder(heading.heading_deg - compass_deg, 360.0)) < 5.0
            await offboard.stop()
            await first(telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.HOLD)
            await action.land()
            await first(telemetry.subscribe_armed(), lambda armed: not armed, within_s=40.0)

    fly(story)
    assert not vehicle.truth().armed
    assert vehicle.truth().height_m == 0.0


@pytest.mark.soak
def test_mavsdk_is_told_the_truth_about_a_refused_offboard(sitl: Any) -> None:
    """MAVSDK believes the first of two acknowledgements (PX4.md, 9): success, and the vehicle stays in Hold."""
    from mavsdk.asyncio.plugins.offboard import OffboardAsync, OffboardError, VelocityBodyYawspeed

    vehicle = sitl(start_height_m=20.0, faults=("0-100 deaf",))

    async def story() -> None:
        async with connected(vehicle) as system:
            offboard = OffboardAsync(system)
            with pytest.raises(OffboardError):
                await offboard.start()  # without any setpoint
            await offboard.set_velocity_body(VelocityBodyYawspeed(0, 0, 0, 0))
            await offboard.start()
            await flown(vehicle, 1.0)

    fly(story)
    assert vehicle.truth().mode == "AUTO/LOITER"


@pytest.mark.soak
def test_mavsdk_flies_attitudes_on_the_airplane(sitl: Any) -> None:
    from mavsdk.asyncio.plugins.offboard import Attitude, OffboardAsync
    from mavsdk.asyncio.plugins.telemetry import FlightMode, TelemetryAsync

    vehicle = sitl(airframe="fixed_wing", start_height_m=100.0)

    async def story() -> None:
        async with connected(vehicle) as system:
            offboard, telemetry = OffboardAsync(system), TelemetryAsync(system)
            await offboard.set_attitude(Attitude(20.0, 0.0, 0.0, 0.87))
            await offboard.start()
            await first(telemetry.subscribe_flight_mode(), lambda mode: mode == FlightMode.OFFBOARD)
            await flown(vehicle, 3.0)
            attitude = await first(telemetry.subscribe_attitude_euler())
            assert attitude.roll_deg == pytest.approx(20.0, abs=0.5)
            assert vehicle.truth().turn_rate_rad_s == pytest.approx(-0.3, abs=0.03)
            metrics = await first(telemetry.subscribe_fixedwing_metrics())
            assert metrics.airspeed_m_s == pytest.approx(12.0, abs=0.7)

    fly(story)


@pytest.mark.soak
def test_mavsdk_reads_and_writes_parameters(sitl: Any) -> None:
    from mavsdk.asyncio.plugins.param import ParamAsync

    vehicle = sitl()

    async def story() -> None:
        async with connected(vehicle) as system:
            param = ParamAsync(system)
            assert await param.get_param_int("NAV_RCL_ACT") == 2
            assert await param.get_param_float("COM_OF_LOSS_T") == 1.0
            await param.set_param_int("COM_OBL_RC_ACT", 5)
            await param.set_param_float("COM_OF_LOSS_T", 0.5)
            everything = await param.get_all_params()
            assert len(everything.int_params) + len(everything.float_params) == len(vehicle.stub.autopilot.params)

    fly(story)
    assert vehicle.stub.autopilot.params["COM_OBL_RC_ACT"] == 5
    assert vehicle.stub.autopilot.params["COM_OF_LOSS_T"] == 0.5


@pytest.mark.soak
def test_mavsdk_cannot_disarm_in_the_air(sitl: Any) -> None:
    from mavsdk.asyncio.plugins.action import ActionAsync, ActionError

    vehicle = sitl(start_height_m=20.0)

    async def story() -> None:
        async with connected(vehicle) as system:
            with pytest.raises(ActionError, match="DENIED"):
                await ActionAsync(system).disarm()

    fly(story)
    assert vehicle.truth().armed


# -- MAVProxy ----------------------------------------------------------------------------------------------------

COMPLAINTS = (
    "timeout", "error", "exception", "traceback", "fail", "no link", "link 1 down", "unknown", "unable", "denied",
    "rejected", "unsupported", "breach", "bad", "retr",
)  # fmt: skip
# MAVProxy says so of the recorded PX4 too: there is no fence among the sensors that SYS_STATUS calls healthy.
SAID_OF_PX4_TOO = frozenset({"fence breach"})


def complaints(log: list[str]) -> list[str]:
    """Return the lines of MAVProxy's log that somebody should look at."""
    plain = (line.rsplit("> ", 1)[-1].strip() for line in log)
    return [line for line in plain if line not in SAID_OF_PX4_TOO and any(c in line.lower() for c in COMPLAINTS)]


class MavProxy:
    """A headless MAVProxy: `say` types a line, `wait_for` waits for words in what it prints."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self._process = process
        self._printed: queue.SimpleQueue[str] = queue.SimpleQueue()
        self.log: list[str] = []
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._printed.put(line.decode(errors="replace").rstrip())

    def say(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(line.encode() + b"\n")
        self._process.stdin.flush()

    def wait_for(self, words: str, within_s: float = 20.0) -> str:
        """Return the next line with these words; what comes before is in `log`."""
        end_s = time.monotonic() + within_s
        while (left_s := end_s - time.monotonic()) > 0.0:
            try:
                self.log.append(self._printed.get(timeout=left_s))
            except queue.Empty:
                break
            if words in self.log[-1]:
                return self.log[-1]
        raise AssertionError(f"MAVProxy did not say {words!r}:\n" + "\n".join(self.log))


@contextmanager
def mavproxy(vehicle: Vehicle, directory: Path) -> Iterator[MavProxy]:
    """Run the MAVProxy of this environment as the vehicle's ground station, or skip."""
    program = Path(sys.executable).with_name("mavproxy.py")
    if not program.exists():
        pytest.skip(f"MAVProxy is not beside {sys.executable}: pip install -e '.[peers]', as make soak does")
    arguments = [f"--master=udpin:127.0.0.1:{vehicle.gcs_port}", "--streamrate=-1", f"--state-basedir={directory}"]
    command = [sys.executable, "-u", str(program), *arguments, "--aircraft=stub", "--force-connected"]
    environment = {**os.environ, "HOME": str(directory)}  # no start-up script of whoever runs this
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=environment
    ) as process:
        try:
            yield MavProxy(process)
        finally:
            process.kill()  # without a vehicle it does not hear SIGTERM


@pytest.mark.soak
def test_mavproxy_connects_fetches_parameters_arms_and_takes_off(sitl: Any, tmp_path: Path) -> None:
    vehicle = sitl(params={"MIS_TAKEOFF_ALT": 4.0})
    parameters = vehicle.stub.autopilot.params
    with mavproxy(vehicle, tmp_path) as station:
        station.wait_for(f"Received {len(parameters)} parameters")
        station.say("mode")
        modes = station.wait_for("Available modes:")
        assert {"OFFBOARD", "LOITER", "TAKEOFF", "LAND", "RTL", "POSCTL"} <= set(modes.replace(",", " ").split())
        station.say("param show COM_OF_LOSS_T")
        assert station.wait_for("COM_OF_LOSS_T").split()[-1] == "1.0"
        station.say("param set COM_OBL_RC_ACT 5")
        time.sleep(1.0)  # it shows what it was told last, and says nothing when it is told more
        station.say("param show COM_OBL_RC_ACT")
        assert station.wait_for("COM_OBL_RC_ACT").split()[-1] in ("5", "5.0")
        station.say("wp list")
        station.wait_for("Requesting 0 waypoints")
        station.say("arm throttle")
        station.wait_for("COMPONENT_ARM_DISARM: ACCEPTED")
        station.wait_for("Armed by external command")
        station.say("long NAV_TAKEOFF 0 0 0 nan nan nan nan")
        station.wait_for("NAV_TAKEOFF: ACCEPTED")
        station.wait_for("Mode TAKEOFF")
        station.wait_for("Takeoff detected")
        station.wait_for("Mode LOITER")
        assert vehicle.truth().height_m > 3.0
        station.say("long DO_SET_MODE 1 4 6 0 0 0 0")  # its own `mode LAND` fails on any PX4: a tuple for a float
        station.wait_for("Mode LAND")
        station.wait_for("Disarmed by landing", within_s=30.0)
    assert parameters["COM_OBL_RC_ACT"] == 5
    assert complaints(station.log) == []


@pytest.mark.soak
def test_what_mavproxy_complains_about_is_noticed(sitl: Any, tmp_path: Path) -> None:
    """The filter of the test above on a log with troubles: a refusal, its own bug, an unknown name, a lost link."""
    vehicle = sitl(faults=("0-600 refuse-arm",))
    with mavproxy(vehicle, tmp_path) as station:
        station.wait_for("Received")
        assert complaints(station.log) == []
        for line, words in (
            ("arm throttle", "Arming denied"),
            ("mode OFFBOARD", "ERROR in command"),
            ("param set NO_SUCH 1", "Unable to find"),
            ("nonsense", "Unknown command"),
        ):
            station.say(line)
            station.wait_for(words)
        vehicle.stop()
        station.wait_for("link 1 down", within_s=30.0)
    found = "\n".join(complaints(station.log))
    for words in ("TEMPORARILY_REJECTED", "Arming denied", "ERROR in command", "Unable to find", "link 1 down"):
        assert words in found
