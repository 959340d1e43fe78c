"""Whether a file can be written, found out before the work that fills it."""

from __future__ import annotations

from pathlib import Path


def refusal(path: Path | None) -> str | None:
    """Return why a file cannot be written, in one line; None where it can, or where none is wanted.

    Makes the folders above it, and leaves no other trace: what is in the file stays.
    """
    if path is None or (path.exists() and not path.is_file() and not path.is_dir()):
        return None  # a pipe or a terminal takes what comes, and only once
    there = path.exists()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("ab").close()
        if not there:
            path.unlink()
    except OSError as error:
        return f"cannot write {path}: {error.strerror or error}"
    return None


def refusal_of_folder(folder: Path | None) -> str | None:
    """Return why files cannot be written into a folder, which is made; None where they can, or where none is wanted."""
    if folder is None:
        return None
    trial = folder / ".trial"
    trouble = refusal(trial)
    return trouble and trouble.replace(str(trial), f"into {folder}", 1)
