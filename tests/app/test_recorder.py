"""The recorder: tools read the tlog, a kill leaves readable files, a full disk stops nothing, names never collide."""

from __future__ import annotations

import struct
import subprocess
import sys
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import all as mavlink

from circumnav_mav.report import read_columns
from circumnav_mav.runtime.recorder import Recorder


def heartbeat(mode: int) -> bytes:
    mav = mavlink.MAVLink(None, 1, 1)
    return bytes(mavlink.MAVLink_heartbeat_message(2, 12, 0x81, mode, 4, 3).pack(mav))


def test_mavlink_tools_read_the_tlog(tmp_path):
    recorder = Recorder(tmp_path, tlog=True, header=["t_s"])
    for mode in range(5):
        recorder.frame(heartbeat(mode))
    recorder.close()
    log = mavutil.mavlogfile(str(recorder.directory / "flight.tlog"))
    modes, stamps = [], []
    while (message := log.recv_msg()) is not None:
        modes.append(message.custom_mode)
        stamps.append(message._timestamp)
    assert modes == list(range(5))
    assert stamps == sorted(stamps)
    assert abs(stamps[0] - (recorder.directory / "flight.tlog").stat().st_mtime) < 60


def test_ticks_come_back_with_their_time_to_the_millisecond(tmp_path):
    recorder = Recorder(tmp_path, tlog=False, header=["t_s", "phase"])
    recorder.tick((12345.678, "orbiting"))
    recorder.close()
    assert read_columns(recorder.directory / "ticks.csv") == {"t_s": ["12345.678"], "phase": ["orbiting"]}
    assert not (recorder.directory / "flight.tlog").exists()


def test_a_place_is_kept_to_the_centimetre(tmp_path):
    recorder = Recorder(tmp_path, tlog=False, header=["target_lat_deg", "target_lon_deg"])
    recorder.tick((-47.39774213, 179.54559417))
    recorder.close()
    (lat,), (lon,) = read_columns(recorder.directory / "ticks.csv").values()
    assert (float(lat), float(lon)) == pytest.approx((-47.39774213, 179.54559417), abs=1e-7)  # 1e-7 deg: 11 mm


def test_a_killed_app_leaves_readable_files(tmp_path):
    """Nobody asks for it: what was recorded is on its way to the disk within a moment."""
    size = 200 * (8 + len(heartbeat(7)))
    script = f"""
import os, time
from pathlib import Path
from circumnav_mav.runtime.recorder import Recorder
recorder = Recorder(Path({str(tmp_path)!r}), tlog=True, header=["t_s", "phase"])
for n in range(200):
    recorder.tick((n / 50, "orbiting"))
    recorder.frame({heartbeat(7)!r})
while (recorder.directory / "flight.tlog").stat().st_size < {size}:  # the last of the files that are flushed
    time.sleep(0.01)
recorder.tick((99.0, "never flushed"))
os.kill(os.getpid(), 9)
"""
    done = subprocess.run([sys.executable, "-c", script], cwd=Path(__file__).parents[2], timeout=60)
    assert done.returncode == -9
    (directory,) = tmp_path.iterdir()
    assert len(read_columns(directory / "ticks.csv")["t_s"]) >= 200
    raw = (directory / "flight.tlog").read_bytes()
    assert len(raw) == size
    assert struct.unpack(">Q", raw[:8])[0] > 1e15


def test_names_do_not_collide_without_a_clock(tmp_path, monkeypatch):
    monkeypatch.setattr("circumnav_mav.runtime.recorder.time.strftime", lambda form: "19700101-000000")
    names = []
    for _ in range(3):
        recorder = Recorder(tmp_path, tlog=False, header=["t_s"])
        names.append(recorder.directory.name)
        recorder.close()
    assert names == ["0001-19700101-000000", "0002-19700101-000000", "0003-19700101-000000"]


def test_a_full_disk_is_noted_and_nothing_is_raised(tmp_path):
    recorder = Recorder(tmp_path, tlog=True, header=["t_s"])
    recorder._files["flight.tlog"].close()
    recorder._files["flight.tlog"] = Path("/dev/full").open("wb")  # noqa: SIM115 - the recorder closes it
    for _ in range(2000):
        recorder.frame(heartbeat(1))
    recorder.tick((1.0,))
    recorder.close()
    path = recorder.directory / "flight.tlog"
    assert recorder.problem == f"the record is incomplete: {path}: No space left on device"
    assert read_columns(recorder.directory / "ticks.csv")["t_s"] == ["1"]


def test_a_directory_that_cannot_be_made_is_noted_and_nothing_is_raised(tmp_path):
    blocker = tmp_path / "file"
    blocker.write_text("")
    recorder = Recorder(blocker / "flights", tlog=True, header=["t_s"])
    recorder.tick((1.0,))
    recorder.frame(heartbeat(1))
    recorder.close()
    assert recorder.directory is None
    assert recorder.problem == f"the record is incomplete: {blocker}/flights: Not a directory"


def test_what_is_dropped_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr("circumnav_mav.runtime.recorder.MOST_WAITING", 0)
    recorder = Recorder(tmp_path, tlog=True, header=["t_s"])
    for _ in range(3):
        recorder.frame(heartbeat(1))
    recorder.close()
    assert "incomplete: 4 lines and frames dropped" in recorder.problem  # the header of ticks.csv, too


@pytest.mark.parametrize("cut", [1, 3])
def test_a_last_line_that_was_cut_off_is_left_out(tmp_path, cut):
    path = tmp_path / "ticks.csv"
    path.write_text("t_s,phase\n1,ready\n2,orbiting\n"[:-cut] if cut == 1 else "t_s,phase\n1,ready\n2")
    assert read_columns(path)["t_s"] == (["1", "2"] if cut == 1 else ["1"])
