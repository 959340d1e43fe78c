"""The files that a configuration names, looked into before anything flies: part of `circumnav check`.

A file of settings may be checked and tuned where those files are not; only `check` asks for all of them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from circumnav_mav.config import Ranging, Record, Vehicle
from circumnav_mav.config_file import Look
from circumnav_mav.endpoint import parse
from circumnav_mav.runtime.keyfile import read_key
from circumnav_mav.runtime.replay_link import recording
from circumnav_mav.runtime.transport import LinkError


def replay_faults(ranging: Ranging) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with the recorded ranges."""
    if ranging.source != "replay" or ranging.endpoint is None or parse(ranging.endpoint).kind != "file":
        return
    endpoint = parse(ranging.endpoint)
    try:
        complaint = recording(endpoint).complaint()
    except LinkError as error:
        yield "ranging.endpoint", str(error)
    else:
        if complaint:
            yield "ranging.endpoint", f"{endpoint}: {complaint}"


def key_faults(vehicle: Vehicle) -> Iterator[tuple[str, str]]:
    """Yield what is wrong with the signing key, without which nothing starts."""
    if vehicle.signing_key_file is None:
        return
    try:
        read_key(vehicle.signing_key_file)
    except ValueError as error:
        yield "vehicle.signing_key_file", str(error)


def record_faults(record: Record) -> Iterator[tuple[str, str]]:
    """Yield why nothing of a flight could be kept. A flight makes the folder; this makes none."""
    folder = Path(record.directory)
    try:
        there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
        tempfile.TemporaryFile(dir=there).close()
    except OSError as error:
        yield (
            "record.directory",
            f"cannot write into {folder}: {error.strerror or error}: a flight would leave no record",
        )


LOOKS: dict[str, Look[Any]] = {"vehicle": key_faults, "ranging": replay_faults, "record": record_faults}
"""By the section of the configuration that names the files."""
