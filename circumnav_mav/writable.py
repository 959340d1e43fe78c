"""Whether a file can be written, found out before the work that fills it; and files that are written over and over."""

from __future__ import annotations

from pathlib import Path


def refusal(path: Path | None) -> str | None:
    """Return why a file cannot be written, in one line; None where it can, or where none is wanted.

    Makes no folder, for a name that is misspelt is no wish for one, and leaves no trace: what is in the file stays.
    """
    if path is None or takes_once(path):
        return None
    try:
        if not path.parent.is_dir():
            what = "is no folder" if path.parent.exists() else "does not exist: make that folder, or mend the name"
            return f"cannot write {path}: {path.parent} {what}"
        there = path.exists()
        path.open("ab").close()
        if not there:
            path.unlink()
    except OSError as error:
        return f"cannot write {path}: {error.strerror or error}"
    return None


def takes_once(path: Path) -> bool:
    """Return whether it is a pipe or a terminal, which takes what comes, and cannot be written anew."""
    return path.exists() and not path.is_file() and not path.is_dir()


def write_anew(path: Path, text: str) -> None:
    """Write a file whole or not at all: whoever reads it meanwhile, or stops the writer, has the old one or the new."""
    target = path.resolve()  # a link stays a link
    part = target.with_name(f".{target.name}.part")
    try:
        part.write_text(text, encoding="utf-8")
        if target.exists():
            part.chmod(target.stat().st_mode & 0o7777)
        part.replace(target)
    except PermissionError:  # the file may be written, its folder not
        target.write_text(text, encoding="utf-8")
    finally:
        part.unlink(missing_ok=True)


def refusal_of_folder(folder: Path | None) -> str | None:
    """Return why files cannot be written into a folder, which is made later where only its own name is missing; None
    where they can, or where none is wanted.
    """
    if folder is None:
        return None
    if takes_once(folder) or folder.is_file():
        return f"cannot write into {folder}: it is no folder"
    trial = folder / ".trial" if folder.is_dir() else folder
    trouble = refusal(trial)
    return trouble and trouble.replace(f"cannot write {trial}", f"cannot write into {folder}", 1)
