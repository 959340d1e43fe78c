"""The dependency rule of the architecture, as a table: who may import what."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WORLD = {"asyncio", "socket", "serial", "time", "mavsdk", "select", "selectors", "threading", "subprocess", "os"}
"""What touches the world: only runtime may."""

RULES: dict[str, set[str]] = {
    # ring (path prefix): what it must not import
    "circumnav_mav/types.py": {"circumnav_mav", "numpy", "pymavlink", *WORLD},
    "circumnav_mav/guidance": {
        "circumnav_mav.ranging",
        "circumnav_mav.mavlink",
        "circumnav_mav.runtime",
        "circumnav_mav.study",
        "circumnav_mav.config",
        "pymavlink",
        "numpy",
        "logging",
        *WORLD,
    },
    "circumnav_mav/ranging": {
        "circumnav_mav.guidance",
        "circumnav_mav.mavlink",
        "circumnav_mav.runtime",
        "circumnav_mav.study",
        "pymavlink",
        *WORLD,
    },
    "circumnav_mav/mavlink": {
        "circumnav_mav.guidance",
        "circumnav_mav.ranging",
        "circumnav_mav.runtime",
        "circumnav_mav.study",
        *WORLD,
    },
    "circumnav_mav/flight.py": {"circumnav_mav.runtime", "circumnav_mav.study", *WORLD},
    "circumnav_mav/flight_record.py": {"circumnav_mav.runtime", "circumnav_mav.study", *WORLD},
    "circumnav_mav/notices.py": {"circumnav_mav.runtime", "circumnav_mav.study", *WORLD},
    "circumnav_mav/range_feed.py": {"circumnav_mav.runtime", "circumnav_mav.study", *WORLD},
    "circumnav_mav/range_words.py": {"circumnav_mav.runtime", "circumnav_mav.study", *WORLD},
    "circumnav_mav/turned_away.py": {"circumnav_mav.runtime", "circumnav_mav.study", *WORLD},
    "circumnav_mav/config.py": {"circumnav_mav.runtime", "circumnav_mav.study", *WORLD},
    "circumnav_mav/config_checks.py": {"circumnav_mav.runtime", "circumnav_mav.study", *WORLD},
    "circumnav_mav/runtime": {"circumnav_mav.study"},
    "circumnav_mav": {"sitl_stub", "pymavlink.mavutil"},
    "sitl_stub": {"circumnav_mav", "pymavlink.mavutil"},
}
PYMAVLINK_DOORS = {"circumnav_mav/mavlink/dialect.py"}


def imports(path: Path) -> set[str]:
    """Return every module that a file imports, wherever in the file."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return found


def files(prefix: str) -> list[Path]:
    path = ROOT / prefix
    return [path] if path.suffix == ".py" else sorted(path.rglob("*.py"))


@pytest.mark.parametrize("ring", RULES)
def test_ring_imports_only_what_it_may(ring):
    assert files(ring), f"{ring} has no files: mend the table"
    for path in files(ring):
        for name in imports(path):
            broken = [bad for bad in RULES[ring] if name == bad or name.startswith(bad + ".")]
            assert not broken, f"{path.relative_to(ROOT)} imports {name}"


def test_pymavlink_has_one_door_in_the_app():
    users = {
        str(path.relative_to(ROOT))
        for path in files("circumnav_mav")
        if any(name.split(".")[0] == "pymavlink" for name in imports(path))
    }
    assert users == PYMAVLINK_DOORS


def test_the_rule_sees_a_breach(tmp_path):
    bad = tmp_path / "bad.py"
    bad.write_text("def f():\n    from socket import socket\n    import asyncio.events\n")
    assert {"socket", "asyncio.events"} <= imports(bad)
