"""What a flight leaves on disk: flight.tlog (both directions), ticks.csv (a line a tick), events.log.

A thread of its own writes: a slow card or a full disk never holds up a tick, and what was written before a kill stays
readable. Times in the tlog are the wall time at the start plus monotonic seconds, so that a clock step leaves no dent.
"""

from __future__ import annotations

import queue
import struct
import threading
import time
from collections.abc import Iterable
from io import BufferedWriter
from pathlib import Path
from typing import NamedTuple

FLUSH_S = 0.5
MOST_WAITING = 50_000
"""Items the queue may hold before the newest are dropped (and counted): a dead disk must not eat the memory."""


class _Item(NamedTuple):
    file: str
    data: bytes


class Recorder:
    """Writes into a new numbered directory under `parent`. Problems are told by `problem`, never raised: a full disk
    does not stop a flight. `directory` is None where not even the directory could be made.
    """

    def __init__(self, parent: Path, *, tlog: bool, header: Iterable[str]) -> None:
        self.dropped = 0
        self._error = ""
        self.directory: Path | None = None
        self._epoch_us = time.time_ns() // 1000 - time.monotonic_ns() // 1000
        self._queue: queue.SimpleQueue[_Item | None] = queue.SimpleQueue()
        self._files: dict[str, BufferedWriter] = {}
        try:
            self.directory = _new_directory(parent)
            for name in ("ticks.csv", "events.log", *(["flight.tlog"] if tlog else [])):
                self._files[name] = (self.directory / name).open("wb")
        except OSError as error:
            self._note(error, self.directory or parent)
        self._put("ticks.csv", (",".join(header) + "\n").encode())
        self._thread = threading.Thread(target=self._write, name="recorder", daemon=True)
        self._thread.start()

    @property
    def problem(self) -> str:
        """What is missing in the record and why, in words; empty where it is whole."""
        lost = f"{self.dropped} lines and frames dropped: the disk did not keep up" if self.dropped else ""
        why = "; ".join(text for text in (self._error, lost) if text)
        return f"the record is incomplete: {why}" if why else ""

    def frame(self, raw: bytes) -> None:
        """Record a frame, received or sent, now: 8 bytes of microseconds, big-endian, then the frame."""
        if "flight.tlog" in self._files:
            stamp = self._epoch_us + time.monotonic_ns() // 1000
            self._put("flight.tlog", struct.pack(">Q", stamp) + raw)

    def tick(self, values: Iterable[object]) -> None:
        """Record one tick, in the order of the header."""
        # Ten digits: a longitude to the centimetre.
        line = ",".join([f"{v:.10g}" if type(v) is float else str(v) for v in values])
        self._put("ticks.csv", (line + "\n").encode())

    def event(self, t_s: float, text: str) -> None:
        """Record something that a person should read."""
        self._put("events.log", f"{t_s:10.3f} {text}\n".encode())

    def _put(self, file: str, data: bytes) -> None:
        if file not in self._files:
            return
        if self._queue.qsize() < MOST_WAITING:
            self._queue.put(_Item(file, data))
        else:
            self.dropped += 1

    def _write(self) -> None:
        flush_next = time.monotonic() + FLUSH_S
        while True:
            try:
                item = self._queue.get(timeout=FLUSH_S)
            except queue.Empty:
                self._flush()
                continue
            if item is None:
                break
            self._try(item)
            if time.monotonic() >= flush_next:
                self._flush()
                flush_next = time.monotonic() + FLUSH_S
        self._flush()
        for name, file in self._files.items():
            try:
                file.close()
            except OSError as error:
                self._note(error, name)

    def _try(self, item: _Item) -> None:
        try:
            self._files[item.file].write(item.data)
        except OSError as error:
            self._note(error, item.file)

    def _flush(self) -> None:
        for name, file in self._files.items():
            try:
                file.flush()
            except OSError as error:
                self._note(error, name)

    def _note(self, error: OSError, where: str | Path) -> None:
        path = error.filename or (self.directory / where if self.directory else where)
        self._error = self._error or f"{path}: {error.strerror or error}"

    def close(self) -> None:
        """Write what is waiting, and close the files."""
        self._queue.put(None)
        self._thread.join(timeout=10.0)


def _new_directory(parent: Path) -> Path:
    """Make and return parent/NNNN-date-time. The number alone makes it unique: a companion may have no clock."""
    parent.mkdir(parents=True, exist_ok=True)
    numbers = [int(p.name[:4]) for p in parent.iterdir() if p.name[:4].isdigit()]
    number = max(numbers, default=0)
    while True:
        number += 1
        directory = parent / f"{number:04d}-{time.strftime('%Y%m%d-%H%M%S')}"
        try:
            directory.mkdir()
        except FileExistsError:
            continue
        return directory
