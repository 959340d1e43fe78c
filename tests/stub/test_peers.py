"""Real peers against the stub: MAVSDK (native asyncio) and MAVProxy. They decide whether the stub passes for a PX4."""

from __future__ import annotations

import asyncio
import math
import os
import shutil
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from sitl_stub.running import Vehicle

pytest_plugins = ["sitl_stub.pytest"]
pytestmark = [pytest.mark.soak, pytest.mark.realtime]
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


def fly(story: Callable[[], Awaitable[None]]) -> None:
    asyncio.run(asyncio.wait_for(story(), 120.0))


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
            await asyncio.sleep(5.0)
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
            await asyncio.sleep(1.0)

    fly(story)
    assert vehicle.truth().mode == "AUTO/LOITER"


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
            await asyncio.sleep(3.0)
            attitude = await first(telemetry.subscribe_attitude_euler())
            assert attitude.roll_deg == pytest.approx(20.0, abs=0.5)
            assert vehicle.truth().turn_rate_rad_s == pytest.approx(-0.3, abs=0.03)
            metrics = await first(telemetry.subscribe_fixedwing_metrics())
            assert metrics.airspeed_m_s == pytest.approx(12.0, abs=0.7)

    fly(story)


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

COMPLAINTS = ("timeout", "error", "exception", "traceback", "fail", "no link", "link 1 down", "unknown")


def mavproxy() -> str:
    """Return how MAVProxy is called, or skip."""
    command = os.environ.get("MAVPROXY") or shutil.which("mavproxy.py")
    if not command:
        pytest.skip("MAVProxy is not installed (pip install MAVProxy, or MAVPROXY=/path/to/mavproxy.py)")
    return command


def test_mavproxy_connects_fetches_parameters_arms_and_takes_off(sitl: Any, tmp_path: Path) -> None:
    vehicle = sitl(params={"MIS_TAKEOFF_ALT": 4.0})
    command = [
        mavproxy(), f"--master=udpin:127.0.0.1:{vehicle.gcs_port}", "--streamrate=-1",
        f"--state-basedir={tmp_path}", "--aircraft=stub", "--force-connected",
    ]  # fmt: skip
    if command[0].endswith(".py") and not os.access(command[0], os.X_OK):
        command.insert(0, sys.executable)
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        assert process.stdin is not None
        for wait_s, line in (
            (12.0, "mode"),
            (1.0, "arm throttle"),
            (1.0, "long NAV_TAKEOFF 0 0 0 nan nan nan nan"),
            (9.0, ""),
        ):
            time.sleep(wait_s)
            process.stdin.write(line.encode() + b"\n")
            process.stdin.flush()
        truth = vehicle.truth()
        process.terminate()
        log = process.communicate(timeout=20.0)[0].decode(errors="replace")
    assert truth.armed, log
    assert truth.height_m > 2.0, log
    assert "OFFBOARD" in log, log  # the mode list
    assert f"Received {len(vehicle.stub.autopilot.params)} parameters" in log, log
    assert not [line for line in log.splitlines() if any(c in line.lower() for c in COMPLAINTS)], log
