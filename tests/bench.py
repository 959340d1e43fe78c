"""`make bench`: what the app costs, as ratios within one run, because machines differ and are noisy.

python -m tests.bench [receive] [lockstep] [stub] [estimators] [study] [loop]     (all by default; loop takes a minute)
"""

from __future__ import annotations

import asyncio
import math
import os
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from typing import TypeVar

from circumnav_mav.config import Config
from circumnav_mav.endpoint import Endpoint
from circumnav_mav.flight import Flight
from circumnav_mav.mavlink.link import AutopilotLink
from circumnav_mav.runtime.clock import Clock, new_event_loop, run_on_grid
from circumnav_mav.runtime.realtime import settle
from circumnav_mav.runtime.udp import UdpLink
from tests.lockstep import Rig, airborne

Measured = TypeVar("Measured")

BATCH = 100
SECONDS = 20.0
LOOP_S = 60.0
RATE_HZ = 50.0


def main() -> None:
    chosen = sys.argv[1:] or list(BENCHES)
    for name in chosen:
        BENCHES[name]()


# -- the receive path ----------------------------------------------------------------------------------------------


def traffic(seconds: float, *, as_left_on: bool) -> list[bytes]:
    """Return the datagrams the stub sends a companion: every default stream of a PX4, or what the app leaves on."""
    rig = Rig(Config(), airborne(step_s=0.01))
    if as_left_on:
        rig.run(3.0)
    start_s, sent = rig.stub.now_s, []
    for n in range(int(seconds * 100)):
        rig.stub.advance(start_s + (n + 1) * 0.01)
        sent += rig.stub.take("offboard")
    return sent


def receive() -> None:
    """CPU of the app's receive path beside a mavutil recv_match loop: same datagrams, same loopback, same run."""
    per_second: dict[bool, tuple[float, float]] = {}
    for title, as_left_on in (("streams the app leaves on", True), ("all default streams of a PX4", False)):
        datagrams = traffic(SECONDS, as_left_on=as_left_on)
        ours, theirs = [], []
        for _ in range(5):
            cpu, share, frames = ours_cpu(datagrams)
            ours.append(cpu)
            theirs.append(mavutil_cpu(datagrams))
        mine, other = statistics.median(ours), statistics.median(theirs)
        per_second[as_left_on] = mine / SECONDS, other / SECONDS
        rates = f"{frames / SECONDS:.0f} msg/s in {len(datagrams) / SECONDS:.0f} datagrams/s"
        print(f"receive, {title}: {rates}, {share:.0%} decoded")
        costs = f"circumnav {mine / frames * 1e6:.2f} us, mavutil {other / frames * 1e6:.2f} us"
        print(f"  a message: {costs}: 1 / {other / mine:.1f}")
    app, loop = per_second[True][0], per_second[False][1]
    print("receive, as flown: the app with the streams it leaves on, beside a mavutil loop that hears what PX4 sends")
    print(f"  {app * 1e3:.2f} and {loop * 1e3:.2f} ms of CPU a second: 1 / {loop / app:.0f}   (wanted: 1 / 8 or less)")


def drained(datagrams: list[bytes], port: int, drain: Callable[[], None]) -> float:
    """Return the CPU time of `drain`, called after each batch that was put into the socket's buffer."""
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    spent = 0.0
    for start in range(0, len(datagrams), BATCH):
        for data in datagrams[start : start + BATCH]:
            sender.sendto(data, ("127.0.0.1", port))
        begin = time.process_time()
        drain()
        spent += time.process_time() - begin
    sender.close()
    return spent


def ours_cpu(datagrams: list[bytes]) -> tuple[float, float, int]:
    receiver, clock = AutopilotLink(["DISTANCE_SENSOR"]), Clock()
    link = UdpLink(Endpoint("udpin", "127.0.0.1", 0))
    link._on_data = lambda data: receiver.receive(data, clock.now()) and None
    spent = drained(datagrams, link.port, lambda: link.drain() and None)
    link.close()
    counts = receiver.counts
    assert counts.frames >= len(datagrams)
    return spent, counts.decoded / counts.frames, counts.frames


def mavutil_cpu(datagrams: list[bytes]) -> float:
    os.environ["MAVLINK20"] = "1"
    os.environ["MAVLINK_DIALECT"] = "common"
    from pymavlink import mavutil

    port = free_port()
    connection = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}")

    def drain() -> None:
        while connection.recv_match() is not None:
            pass

    spent = drained(datagrams, port, drain)
    connection.close()
    return spent


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


# -- the loop ------------------------------------------------------------------------------------------------------


def loop() -> None:
    """Tick lateness of the whole app beside 400 msg/s, and of a bare timerfd loop beside it, for a minute."""
    port = free_port()
    command = [sys.executable, "-m", "sitl_stub", "--airborne", "15", "--offboard-port", str(port)]
    command += ["--offboard-listen", "0", "--gcs-port", "0", "--gcs-listen", "0"]
    vehicle = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    bare = subprocess.Popen(
        [sys.executable, "-m", "tests.bench_timerfd", str(RATE_HZ), str(LOOP_S)], stdout=subprocess.PIPE
    )
    late_s: list[float] = []
    try:
        frames = fly_for(port, late_s)
        out, _ = bare.communicate(timeout=LOOP_S)
    finally:
        vehicle.terminate()
        vehicle.wait()
        bare.kill()
        bare.wait()
    theirs = float(out)
    ours = percentile(late_s, 99)
    print(f"loop, {RATE_HZ:g} Hz for {LOOP_S:g} s beside {frames / LOOP_S:.0f} msg/s, {len(late_s)} ticks")
    print(f"  late p99: circumnav {ours * 1e6:.0f} us, bare timerfd loop {theirs * 1e6:.0f} us")
    print(f"  ratio {ours / theirs:.2f}   (wanted: 1.5 or less)")


def fly_for(port: int, late_s: list[float]) -> int:
    """Run the app's loop, its streams left at PX4's defaults so that there are 400 msg/s; return the frames heard."""
    flight, clock = Flight(Config()), Clock()
    link = UdpLink(Endpoint("udpin", "127.0.0.1", port))

    def tick(now_s: float, lateness_s: float, missed: int) -> bool:
        late_s.append(lateness_s)
        frames, _ = flight.tick(now_s, lateness_s, missed)
        for frame in frames:
            if frame[7:10] != b"\x4c\x00\x00":  # COMMAND_LONG: the requests that would turn streams off
                link.send(frame)
        return now_s < LOOP_S

    events = new_event_loop()
    settle()

    async def run() -> None:
        here = asyncio.get_running_loop()
        link.start(here, lambda data: flight.receive(data, clock.now()) and None, lambda up, words: None)
        await run_on_grid(clock, RATE_HZ, tick)

    events.run_until_complete(run())
    link.close()
    events.close()
    return flight.link.counts.frames


def percentile(values: list[float], q: float) -> float:
    return sorted(values)[min(len(values) - 1, math.ceil(len(values) * q / 100) - 1)]


# -- lockstep ------------------------------------------------------------------------------------------------------


def lockstep() -> None:
    """A 300 s flight at 50 Hz over real bytes in memory, on one core."""
    rig = Rig(Config(), airborne()).engage()
    begin_s, begin = rig.now_s, time.process_time()
    rig.run(300.0)
    spent = time.process_time() - begin
    print(f"lockstep, 50 Hz, real bytes: 300 s of flight in {spent:.2f} s of CPU")
    print(f"  {(rig.now_s - begin_s) / spent:.0f} x real time on one core   (wanted: 100 or more)")
    print(f"  yardstick: pymavlink packs an ATTITUDE in {pymavlink_pack_us():.1f} us on this machine, now")


def pymavlink_pack_us() -> float:
    from pymavlink.dialects.v20 import all as mavlink

    mav, count = mavlink.MAVLink(None, 1, 1), 20_000
    begin = time.process_time()
    for _ in range(count):
        mavlink.MAVLink_attitude_message(1, 2, 3, 4, 5, 6, 7.5).pack(mav)
    return (time.process_time() - begin) / count * 1e6


WANTED_US = {"direct": 20.0, "polar": 20.0, "drift": 100.0}


def estimators() -> None:
    """What a range costs each estimator, in flight, beside a fixed piece of work of the same kind in the same run."""
    from circumnav_mav.study import cost

    print("estimators, in plain Python: an update, one while the ring of hypotheses is full, a tick")
    alone, yardstick = beside_the_yardstick(cost.estimator_costs)
    for one in alone:
        times = one.update_us, one.full_us, one.tick_us
        figures = ", ".join(f"{us:.1f} us ({us / yardstick:.2f})" for us in times)
        wanted = WANTED_US.get(one.estimator)
        print(
            f"  {one.estimator:7s} {figures}" + (f"   (wanted: an update in {wanted:g} us or less)" if wanted else "")
        )
    print("entries of tangent on drift: how long more than 6 hypotheses are kept; updates meanwhile, median and 99 %")
    entries, yardstick_then = beside_the_yardstick(cost.entry_costs)
    for entry in entries:
        least_s, median_s, most_s = entry.open_s
        figures = ", ".join(f"{us:.0f} us ({us / yardstick_then:.1f})" for us in (entry.open_us, entry.worst_us))
        print(f"  {entry.name}: {median_s:.0f} s ({least_s:.0f} to {most_s:.0f}); {figures}")
    took = f"{yardstick:.1f} us on this machine beside the first, {yardstick_then:.1f} us beside the entries"
    print(f"  in brackets: in packings of an ATTITUDE by pymavlink, {took}")


def beside_the_yardstick(measure: Callable[[], list[Measured]]) -> tuple[list[Measured], float]:
    """Return what was measured, and the least that a packing took before and after it: a machine's clock changes."""
    before = min(pymavlink_pack_us() for _ in range(5))
    measured = measure()
    return measured, min(before, *(pymavlink_pack_us() for _ in range(5)))


def study() -> None:
    """The study's core beside a C program that flies the same."""
    from tests.paper import bench_core

    print("study, trajectory-steps a second")
    bench_core.main()


def stub() -> None:
    """The simulated vehicle alone."""
    from tests.stub import bench

    bench.main()


BENCHES = {
    "receive": receive,
    "lockstep": lockstep,
    "stub": stub,
    "estimators": estimators,
    "study": study,
    "loop": loop,
}


if __name__ == "__main__":
    main()
