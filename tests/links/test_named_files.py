"""What `circumnav check` finds in the files that a configuration names: before anything flies, and all at once."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from circumnav_mav import cli
from circumnav_mav.config_file import ConfigError


def checked(tmp_path, text: str) -> list[str]:
    """Return the faults that `check` finds, or nothing where it finds none."""
    (tmp_path / "c.yaml").write_text(text.replace("HERE", str(tmp_path)))
    done = CliRunner().invoke(cli.app, ["check", str(tmp_path / "c.yaml")])
    if done.exception is None:
        return []
    assert isinstance(done.exception, ConfigError), done.exception
    return [line.removeprefix(f"{tmp_path}/c.yaml:") for line in done.exception.lines()]


REPLAY = "ranging:\n  source: replay\n  endpoint: file://HERE/r.csv\n"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot read it: No such file or directory"),
        (b"", "it holds no ranges; a line is t_s,range_m"),
        (b"\xff\xfe", "cannot read it: it is not UTF-8 text"),
        (b"1,80\n2,80.1\n3;80.2\n4;80.3\n", "line 3 is no range (nor is 1 more): '3;80.2'; a line is t_s,range_m"),
    ],
)
def test_a_recording_is_looked_into(tmp_path, content, words):
    if content is not None:
        (tmp_path / "r.csv").write_bytes(content)
    (fault,) = checked(tmp_path, REPLAY)
    assert fault.startswith(f"3: ranging.endpoint: file://{tmp_path}/r.csv: {words}")


def test_a_signing_key_is_read(tmp_path):
    text = "vehicle: {signing_key_file: HERE/key}"
    assert checked(tmp_path, text) == [
        f"1: vehicle.signing_key_file: {tmp_path}/key: cannot read it: No such file or directory"
    ]
    (tmp_path / "key").write_text("a passphrase")
    (tmp_path / "key").chmod(0o644)
    (fault,) = checked(tmp_path, text)
    assert "others may read it" in fault
    (tmp_path / "key").chmod(0o600)
    assert checked(tmp_path, text) == []


def test_where_a_flight_is_kept_is_tried_and_not_made(tmp_path):
    (tmp_path / "file").write_text("kept")
    (fault,) = checked(tmp_path, "record: {directory: HERE/file/deep}")
    assert fault == (
        f"1: record.directory: cannot write into {tmp_path}/file/deep: Not a directory: a flight would leave no record"
    )
    assert checked(tmp_path, "record: {directory: HERE/new/deep}") == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c.yaml", "file"]


def test_faults_of_files_are_told_beside_all_others(tmp_path):
    """Also where the file of settings does not load: its sections are looked into as far as they are right."""
    faults = checked(
        tmp_path, REPLAY + "  bias_m: abc\nvehicle: {signing_key_file: HERE/key, clas: x}\nlaw: {kappa: 0}"
    )
    assert [fault.split(": ")[1] for fault in faults] == [
        "ranging.endpoint",
        "ranging.bias_m",
        "vehicle.clas",
        "vehicle.signing_key_file",
    ]


def test_a_good_recording_passes(tmp_path):
    (tmp_path / "r.csv").write_text("t_s,range_m\n1,80\n")
    assert checked(tmp_path, REPLAY) == []
