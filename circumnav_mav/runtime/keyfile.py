"""The signing key's file: read once, and only where nobody else can."""

from __future__ import annotations

import os
import stat
import time
from pathlib import Path

from circumnav_mav.mavlink.signing import Signer, key_from, timestamp
from circumnav_mav.runtime.transport import LinkError


def open_signer(key_file: str | None, now_s: float) -> Signer | None:
    """Return the signer of the configured key, None without one; now_s: the flight's clock at this moment.

    Raises LinkError, in words, for a file that cannot be read, holds no key, or may be read by others.
    """
    if key_file is None:
        return None
    try:
        key = read_key(key_file)
    except ValueError as error:
        raise LinkError(f"vehicle.signing_key_file {error}") from error
    return Signer(key, timestamp(time.time() - now_s))


def read_key(key_file: str) -> bytes:
    """Return the key of a file. Raises ValueError, which begins with the file's name, where it holds no usable key."""
    path = Path(key_file).expanduser()
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            content = file.read(4096)
    except OSError as error:
        raise ValueError(f"{path}: cannot read it: {error.strerror or error}") from error
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ValueError(f"{path}: others may read it (mode {stat.S_IMODE(mode):03o}): chmod 600 {path}")
    try:
        return key_from(content)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
