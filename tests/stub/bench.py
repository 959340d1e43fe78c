"""What the stub costs: `python -m tests.stub.bench`, a part of `make bench`. CPU time, the best of several runs.

An empty loop says how fast the machine is at the moment: whoever shares it makes everything dearer by the same factor.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

from pymavlink.dialects.v20 import all as mavlink

from sitl_stub import Stub, StubConfig
from sitl_stub.running import free_port

KEPT = {0, 1, 30, 32, 33, 74, 111, 132, 242, 245, 436}  # streams that an app leaves on


def empty_loop_us() -> float:
    """Return what 1000 turns of an empty loop cost now [us]; 12 to 15 on an idle 3 GHz core."""
    best = 1e9
    for _ in range(200):
        began = time.perf_counter()
        for _ in range(1000):
            pass
        best = min(best, time.perf_counter() - began)
    return best * 1e6


def full_streams(seconds: float = 60.0) -> float:
    """Return flight seconds per CPU second with every default stream."""
    stub = Stub(StubConfig(start_height_m=30.0, start_east_m=200.0))
    began = time.process_time()
    for k in range(1, round(seconds * 50) + 1):
        stub.advance(k * 0.02)
        stub.take("offboard")
        stub.take("gcs")
    return seconds / (time.process_time() - began)


def lockstep(step_s: float, seconds: float = 60.0) -> float:
    """Return CPU microseconds per 20 ms tick in OFFBOARD with the streams that an app leaves on."""
    stub = Stub(StubConfig(start_height_m=30.0, start_east_m=200.0, step_s=step_s))
    link = stub.links["offboard"]
    for msgid in set(link.intervals_s) - KEPT:
        link.set_interval(msgid, 0.0, 0.0)
    mav = mavlink.MAVLink(None, 1, 191)
    setpoint = mavlink.MAVLink_set_position_target_local_ned_message(0, 1, 1, 8, 1479, *[0] * 3, 5, *[0] * 6, 0.1)
    frame = setpoint.pack(mav)
    request = mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, 6, 0, 0, 0, 0, 0).pack(mav)
    ticks = round(seconds * 50)
    began = time.process_time()
    for k in range(1, ticks + 1):
        stub.receive("offboard", frame)
        if k == 50:
            stub.receive("offboard", request)
        stub.advance(k * 0.02)
        stub.take("offboard")
    taken = time.process_time() - began
    assert stub.truth().mode == "OFFBOARD"
    return taken / ticks * 1e6


def sockets(seconds: float = 15.0) -> tuple[float, float, float]:
    """Return (start to ready [s], its CPU time [s], CPU share of a core afterwards), every default stream."""
    ports = ["--offboard-port", str(free_port()), "--offboard-listen", "0", "--gcs-port", str(free_port())]
    command = [sys.executable, "-m", "sitl_stub", "--airborne", "20", *ports, "--gcs-listen", "0"]
    began = time.monotonic()
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        ready_s = time.monotonic() - began
        before = cpu_s(process.pid)
        time.sleep(seconds)
        share = (cpu_s(process.pid) - before) / seconds
        process.terminate()
    return ready_s, before, share


def cpu_s(pid: int) -> float:
    """Return the CPU time of a process so far (Linux)."""
    fields = Path(f"/proc/{pid}/stat").read_text().split()
    return (int(fields[13]) + int(fields[14])) / 100.0


RUNS = 5


def main() -> None:
    print(f"stub: the best of {RUNS} runs; an empty loop of 1000 turns takes {empty_loop_us():.1f} us now")
    rows: list[tuple[float, float, float]] = []
    for _ in range(RUNS):
        rows.append((full_streams(20.0), lockstep(0.02, 20.0), lockstep(0.01, 20.0)))
    started = [sockets(6.0) for _ in range(RUNS)]
    print(f"  lockstep, all default streams: {max(r[0] for r in rows):.0f} x real time   (wanted: 100 or more)")
    print(f"  OFFBOARD at 50 Hz, step 0.02 s: {min(r[1] for r in rows):.0f} us per 20 ms")
    print(f"  OFFBOARD at 50 Hz, step 0.01 s: {min(r[2] for r in rows):.0f} us per 20 ms")
    print(
        f"  over UDP at speed 1, default streams: {min(s for _, _, s in started):.1%} of a core   (wanted: 5 % or less)"
    )
    ready_s, cpu = min(r for r, _, _ in started), min(c for _, c, _ in started)
    print(f"  start to ready: {ready_s:.2f} s, {cpu:.2f} s of CPU   (wanted: less than 0.5 s)")


if __name__ == "__main__":
    main()
