"""The link-related keys of the configuration: endpoints in both spellings, and options in the source's own words."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from circumnav_mav.config_file import ConfigError, parse
from circumnav_mav.endpoint import parse as parse_endpoint
from circumnav_mav.range_feed import RangeFeed
from circumnav_mav.ranging import SOURCES, ByteSource
from circumnav_mav.runtime.demo import demo_config, demo_note

SERIAL = "serial:///dev/ttyUSB0:115200"
NEEDED = {"lines": "pattern: 'D=(?P<range>[0-9.]+)'"}
"""Options without which a source says nothing."""


def faults(text: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        parse(text, "c.yaml")
    return list(caught.value.lines())


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("serial:///dev/ttyACM0:57600", "serial:///dev/ttyACM0:57600"),
        ("serial:///dev/ttyACM0", "serial:///dev/ttyACM0"),
        ("serial:/dev/ttyACM0:57600", "serial:///dev/ttyACM0:57600"),
        ("/dev/ttyACM0,57600", "serial:///dev/ttyACM0:57600"),
        ("/dev/ttyACM0:57600", "serial:///dev/ttyACM0:57600"),
        ("/dev/ttyACM0", "serial:///dev/ttyACM0"),
        ("/dev/serial/by-id/usb-3D_PX4_FMU-if00,921600", "serial:///dev/serial/by-id/usb-3D_PX4_FMU-if00:921600"),
        (
            "/dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0",
            "serial:///dev/serial/by-path/pci-0000:00:14.0-usb-0:1:1.0-port0",
        ),
        ("tcp:127.0.0.1:5760", "tcpout://127.0.0.1:5760"),
        ("tcp://127.0.0.1:5760", "tcpout://127.0.0.1:5760"),
        ("tcpout://fc.local:5760", "tcpout://fc.local:5760"),
        ("tcpin:0.0.0.0:5760", "tcpin://0.0.0.0:5760"),
        ("tcpin://:5760", "tcpin://0.0.0.0:5760"),
        ("file://flights/ranges.csv", "file://flights/ranges.csv"),
        ("file:///var/ranges.csv", "file:///var/ranges.csv"),
    ],
)
def test_an_endpoint_in_either_spelling(text, shown):
    endpoint = parse_endpoint(text)
    assert str(endpoint) == shown
    assert parse_endpoint(shown) == endpoint


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("tcpout://:5760", "address to call"),
        ("tcpout://127.0.0.1:0", "between 1 and 65535"),
        ("tcp:127.0.0.1:70000", "between 1 and 65535"),
        ("serial:///dev/ttyUSB0:57", "baud"),
        ("ttyUSB0", "serial:///dev/ttyACM0:57600"),
        ("http://127.0.0.1:80", "tcpout"),
        ("", "udpin"),
    ],
)
def test_what_is_no_endpoint_is_refused_in_words(text, words):
    with pytest.raises(ValueError, match=words):
        parse_endpoint(text)


@pytest.mark.parametrize("name", [name for name, source in SOURCES.items() if isinstance(source, ByteSource)])
def test_a_device_needs_its_endpoint_and_then_loads(name):
    options = f", {NEEDED[name]}" if name in NEEDED else ""
    (line,) = faults(f"ranging: {{source: {name}{options}}}")
    assert line.startswith("c.yaml:1: ranging.endpoint: ") and f"{SOURCES[name].baud}" in line
    ranging = parse(f"ranging: {{source: {name}, endpoint: '{SERIAL}'{options}}}").ranging
    assert RangeFeed(ranging).source is SOURCES[name]


@pytest.mark.parametrize(
    ("keys", "path", "words"),
    [
        ("source: us_d1, min_snr: loud", "ranging.min_snr", "must be a number"),
        ("source: us_d1, min_sn: 3", "ranging.min_sn", "did you mean 'min_snr'?"),
        ("source: us_d1, max_ages_s: 3", "ranging.max_ages_s", "did you mean 'max_age_s'?"),
        ("source: linktrack, min_snr: 3", "ranging.min_snr", "no such key for linktrack"),
        ("source: lines, pattern: '(', range_unit: cm", "ranging.pattern", "no regular expression"),
        ("source: lines, pattern: '(?P<r>.)'", "ranging.pattern", "the fields are range"),
        ("source: lines, json: {range: d}, range_unit: furlong", "ranging.range_unit", "one of m, dm"),
        ("source: lines", "ranging.source", "either a pattern or json"),
    ],
)
def test_options_are_judged_at_load_by_the_source(keys, path, words):
    (line,) = faults(f"ranging:\n  {keys.replace(', ', chr(10) + '  ')}\n  endpoint: '{SERIAL}'\n")
    place, where, text = line.split(": ", 2)
    assert where == path and words in text, line
    assert place.startswith("c.yaml:"), line
    assert not text.startswith("ranging"), line


def test_a_message_source_takes_no_options_of_another():
    (line,) = faults("ranging:\n  source: distance_sensor\n  pattern: x\n")
    assert line == "c.yaml:3: ranging.pattern: no such key for distance_sensor"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("ranging: {source: linktrack, endpoint: 'file://a.csv'}", "read by the source replay"),
        ("vehicle: {link: 'file://a.tlog'}", "no link to an autopilot"),
        ("ranging: {min_m: 5, max_m: 3}", "not below"),
        ("ranging: {endpoint: 'udpin:0.0.0.0:14540'}", "is vehicle.link"),
        ("ranging: {min_quality_pct: 120}", "100"),
        ("ranging: {stuck_s: -1}", "0"),
    ],
)
def test_what_does_not_fit_together_is_said(text, words):
    assert any(words in line for line in faults(text)), faults(text)


@settings(deadline=None)
@given(st.text(st.sampled_from("serialudptcpnouf:/.,0123456789-[]COM \n"), max_size=40) | st.text(max_size=20))
def test_any_text_is_an_endpoint_that_reads_back_or_an_error_in_one_line(text):
    try:
        endpoint = parse_endpoint(text)
    except ValueError as error:
        assert "\n" not in str(error)
    else:
        assert parse_endpoint(str(endpoint)) == endpoint


def test_the_demo_flies_what_the_file_says_of_the_height_or_says_that_it_does_not():
    """The stub's beacon is on the ground: where the file calls ranges horizontal, the demo takes them as they are."""
    plane = "vehicle: {class: px4_fixed_wing}\n"
    for text, flown in (("", 0.0), (plane, "auto"), ("ranging: {target_height_m: 2}", 2.0)):
        assert demo_config(parse(text)).ranging.target_height_m == flown
        assert ("the demo flew with 0" in demo_note(parse(text))) is (text == "")
    assert demo_note(None) == demo_note(parse(""))


def test_the_demo_flies_the_stubs_radio_whatever_the_file_names():
    ranging = demo_config(parse(f"ranging: {{source: linktrack, endpoint: '{SERIAL}', bias_m: 0.2}}")).ranging
    assert (ranging.source, ranging.endpoint, ranging.bias_m) == ("distance_sensor", None, 0.2)
