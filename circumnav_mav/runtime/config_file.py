"""Write one value back into a configuration file: whole or not at all, with its permissions and its owner kept."""

from __future__ import annotations

import os
import tempfile
from contextlib import suppress
from pathlib import Path

from circumnav_mav.yaml_line import with_value


def why_not(path: Path, section: str, key: str) -> str:
    """Return why `write_value` would not set a number there; empty where it would, as far as can be told before."""
    try:
        with_value(path.read_text(encoding="utf-8"), section, key, "0.0")
    except ValueError as error:
        return str(error)
    except OSError as error:
        return error.strerror or str(error)
    return ""


def write_value(path: Path, section: str, key: str, value: str) -> None:
    """Set `section.key` in the file. Raises ValueError or OSError, and then the file is as it was."""
    target = path.resolve()  # a link stays a link
    with target.open(encoding="utf-8", newline="") as file:
        text, state = file.read(), os.fstat(file.fileno())
    edited = with_value(text, section, key, value)
    handle, name = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="") as file:
            file.write(edited)
            file.flush()
            os.fchmod(handle, state.st_mode & 0o7777)
            with suppress(PermissionError):  # only root may give a file away
                os.fchown(handle, state.st_uid, state.st_gid)
            os.fsync(handle)
        Path(name).replace(target)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
