"""From an endpoint to an open link."""

from __future__ import annotations

from circumnav_mav.config import Ranging
from circumnav_mav.endpoint import Endpoint, parse
from circumnav_mav.range_feed import RangeFeed
from circumnav_mav.runtime.replay_link import ReplayLink
from circumnav_mav.runtime.serial_port import SerialLink
from circumnav_mav.runtime.stream import Steps
from circumnav_mav.runtime.tcp import TcpClient, TcpServer
from circumnav_mav.runtime.transport import Transport
from circumnav_mav.runtime.udp import UdpLink

VEHICLE_BAUD = 57_600
"""Where the link names none: what PX4's TELEM 1 and MAVSDK take."""


def open_link(endpoint: Endpoint, *, default_baud: int = VEHICLE_BAUD, steps: Steps = ()) -> Transport:
    """Open a link; `steps` make a silent device talk. Raises LinkError, in words, where it cannot be opened."""
    if endpoint.kind == "serial":
        return SerialLink(endpoint, default_baud, steps)
    if endpoint.kind == "tcpout":
        return TcpClient(endpoint, steps)
    if endpoint.kind == "tcpin":
        return TcpServer(endpoint, steps)
    if endpoint.kind == "file":
        return ReplayLink(endpoint)
    return UdpLink(endpoint)


def open_ranging_link(ranging: Ranging, feed: RangeFeed) -> Transport:
    """Open the radio's own endpoint, which the configuration must name. Raises LinkError, in words."""
    assert ranging.endpoint is not None
    return open_link(parse(ranging.endpoint), default_baud=feed.baud, steps=feed.start)
