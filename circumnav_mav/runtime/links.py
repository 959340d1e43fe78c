"""From an endpoint to an open link."""

from __future__ import annotations

from circumnav_mav.config import Vehicle
from circumnav_mav.endpoint import USUAL_BAUD, Endpoint, parse
from circumnav_mav.range_feed import RangeFeed
from circumnav_mav.runtime.mavsdk_link import MavsdkLink
from circumnav_mav.runtime.replay_link import ReplayLink
from circumnav_mav.runtime.serial_port import SerialLink
from circumnav_mav.runtime.stream import Steps, Understood
from circumnav_mav.runtime.tcp import TcpClient, TcpServer
from circumnav_mav.runtime.transport import Transport
from circumnav_mav.runtime.udp import UdpLink


def open_link(
    endpoint: Endpoint, *, default_baud: int = USUAL_BAUD, steps: Steps = (), understood: Understood = lambda: 0
) -> Transport:
    """Open a link; `steps` make a device talk of which nothing is `understood`, where it is a stream.

    Raises LinkError, in words, where it cannot be opened.
    """
    if endpoint.kind == "serial":
        return SerialLink(endpoint, default_baud, steps, understood)
    if endpoint.kind == "tcpout":
        return TcpClient(endpoint, steps, understood)
    if endpoint.kind == "tcpin":
        return TcpServer(endpoint, steps, understood)
    if endpoint.kind == "file":
        return ReplayLink(endpoint)
    return UdpLink(endpoint)


def open_vehicle_link(vehicle: Vehicle) -> Transport:
    """Open the link to the autopilot, through the library that the configuration names. Raises LinkError, in words."""
    endpoint = parse(vehicle.link)
    return MavsdkLink(endpoint, vehicle.system_id) if vehicle.library == "mavsdk" else open_link(endpoint)


def open_ranging_link(endpoint: Endpoint, feed: RangeFeed) -> Transport:
    """Open the radio's own endpoint, at the device's own speed and with what makes it talk. Raises LinkError."""
    return open_link(endpoint, default_baud=feed.baud, steps=feed.start, understood=lambda: feed.understood)
