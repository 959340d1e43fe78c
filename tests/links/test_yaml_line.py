"""Writing bias_m back: one line changes, and nothing else in the file."""

from __future__ import annotations

import difflib
import os
import stat
from pathlib import Path

import pytest
import yaml

from circumnav_mav.runtime.config_file import write_value
from circumnav_mav.yaml_line import with_value

ROOT = Path(__file__).parents[2]


def bias(text: str) -> str:
    return with_value(text, "ranging", "bias_m", "0.312")


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("ranging:\n  bias_m: 0.0   # m; the antenna\n", "ranging:\n  bias_m: 0.312   # m; the antenna\n"),
        ("ranging:\n  bias_m:\n  sigma_m: 1\n", "ranging:\n  bias_m: 0.312\n  sigma_m: 1\n"),
        ("ranging:\n  bias_m: '0.5'\n", "ranging:\n  bias_m: 0.312\n"),
        ("ranging: {bias_m: -1e-2, sigma_m: 1}\n", "ranging: {bias_m: 0.312, sigma_m: 1}\n"),
        ("ranging: {sigma_m: 1}  # short\n", "ranging: {bias_m: 0.312, sigma_m: 1}  # short\n"),
        ("ranging: {}\n", "ranging: {bias_m: 0.312}\n"),
        ("ranging:\n    # why\n    sigma_m: 1\n", "ranging:\n    # why\n    bias_m: 0.312\n    sigma_m: 1\n"),
        ("ranging:\norbit: {radius_m: 5}\n", "ranging:\n  bias_m: 0.312\norbit: {radius_m: 5}\n"),
        ("ranging:   # later\norbit: {}\n", "ranging:\n  bias_m: 0.312   # later\norbit: {}\n"),
        ("orbit: {radius_m: 5}", "orbit: {radius_m: 5}\nranging:\n  bias_m: 0.312\n"),
        ("{orbit: {radius_m: 5}}", "{ranging: {bias_m: 0.312}, orbit: {radius_m: 5}}"),
        ("{}\n", "{ranging: {bias_m: 0.312}}\n"),
        ("# nothing yet\n", "# nothing yet\nranging:\n  bias_m: 0.312\n"),
        ("", "ranging:\n  bias_m: 0.312\n"),
        ("ranging:\r\n  bias_m: 0\r\norbit: {}\r\n", "ranging:\r\n  bias_m: 0.312\r\norbit: {}\r\n"),
        ("a: {bias_m: 1}\nranging:\n  bias_m: 2\n", "a: {bias_m: 1}\nranging:\n  bias_m: 0.312\n"),
        ("ranging:\n  json: {range: bias_m}\n", "ranging:\n  bias_m: 0.312\n  json: {range: bias_m}\n"),
    ],
)
def test_one_value_changes_and_nothing_else(before, after):
    assert bias(before) == after
    assert yaml.safe_load(after)["ranging"]["bias_m"] == 0.312


@pytest.mark.parametrize("path", sorted((ROOT / "configs").glob("*.yaml")), ids=lambda p: p.name)
def test_a_shipped_file_keeps_every_comment(path):
    text = path.read_text()
    edited = bias(text)
    changed = [d for d in difflib.ndiff(text.splitlines(), edited.splitlines()) if d[0] in "+-"]
    assert all("bias_m: 0.312" in d if d[0] == "+" else "bias_m" in d for d in changed)
    if "bias_m" in text:
        assert [d[0] for d in changed] == ["-", "+"]
        assert changed[0].split("#")[1] == changed[1].split("#")[1]
    else:
        assert [d[0] for d in changed] == ["+"]


@pytest.mark.parametrize(
    "text",
    [
        "base: &b {sigma_m: 1}\nranging:\n  <<: *b\norbit: *b\nranging2: [\n",
        "ranging: 5\n",
        "- 1\n",
        "base: &b {bias_m: 1}\nranging: *b\n",
    ],
)
def test_what_cannot_be_edited_safely_is_left_and_said(text):
    with pytest.raises(ValueError, match=r"by hand|not YAML"):
        bias(text)


def test_the_file_keeps_its_permissions_and_a_link_stays_a_link(tmp_path):
    real, link = tmp_path / "real.yaml", tmp_path / "link.yaml"
    real.write_text("ranging:\n  bias_m: 0  # here\n")
    real.chmod(0o640)
    link.symlink_to(real)
    write_value(link, "ranging", "bias_m", "0.5")
    assert link.is_symlink() and real.read_text() == "ranging:\n  bias_m: 0.5  # here\n"
    assert stat.S_IMODE(real.stat().st_mode) == 0o640
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link.yaml", "real.yaml"]


def test_a_write_that_fails_leaves_the_file_and_no_litter(tmp_path, monkeypatch):
    path = tmp_path / "c.yaml"
    path.write_text("ranging: {}\n")

    def full(fd: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        write_value(path, "ranging", "bias_m", "0.5")
    assert path.read_text() == "ranging: {}\n"
    assert list(tmp_path.iterdir()) == [path]
