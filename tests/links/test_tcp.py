"""TCP links over loopback: client and server, lost and found again, and never a torn frame."""

from __future__ import annotations

import socket

import pytest

from circumnav_mav.endpoint import parse
from circumnav_mav.mavlink.codec import Packer, Splitter
from circumnav_mav.runtime.links import open_link
from circumnav_mav.runtime.transport import Backoff, LinkError
from tests.links.fake_loop import PATIENCE_S, Wire


class Router:
    """The other end of a client: a server of the test's own."""

    def __init__(self, port: int = 0) -> None:
        self.listener = socket.create_server(("127.0.0.1", port))
        self.listener.settimeout(PATIENCE_S)
        self.port = self.listener.getsockname()[1]

    def accept(self) -> socket.socket:
        caller, _ = self.listener.accept()
        caller.settimeout(PATIENCE_S)
        return caller


@pytest.fixture
def router():
    made = Router()
    yield made
    made.listener.close()


def call(port: int) -> Wire:
    return Wire(open_link(parse(f"tcp:127.0.0.1:{port}")))


def listen() -> Wire:
    return Wire(open_link(parse("tcpin://127.0.0.1:0")))


def dial(wire: Wire) -> socket.socket:
    caller = socket.create_connection(("127.0.0.1", wire.link.port), PATIENCE_S)
    wire.loop.turn(PATIENCE_S)
    return caller


def test_a_client_speaks_and_hears(router):
    wire = call(router.port)
    peer = router.accept()
    peer.sendall(b"from there")
    wire.loop.until(lambda: wire.data == b"from there")
    wire.link.send(b"from here")
    assert peer.recv(100) == b"from here"
    assert wire.changes == [] and not wire.link.whole
    wire.link.close()
    assert peer.recv(100) == b""
    peer.close()


def test_a_client_calls_again_until_somebody_answers(router):
    wire = call(router.port)
    router.accept().close()
    router.listener.close()
    wire.loop.until(lambda: wire.ups == [False])
    assert "trying" in wire.changes[0][1]
    wire.link.send(b"lost")
    wire.loop.advance(4.0)  # refused, four times
    assert wire.ups == [False]
    again = Router(router.port)
    wire.loop.advance(Backoff.MOST_S)
    wire.loop.until(lambda: wire.ups == [False, True])
    peer = again.accept()
    wire.link.send(b"found")
    assert peer.recv(100) == b"found"  # and nothing of what was sent while it was lost
    wire.link.close()
    peer.close()
    again.listener.close()


def test_a_closed_client_calls_no_more(router):
    wire = call(router.port)
    router.accept().close()
    wire.loop.until(lambda: wire.ups == [False])
    wire.link.close()
    assert wire.loop.due_s == [] and not wire.loop.readers and not wire.loop.writers


def test_a_server_waits_hears_and_waits_again():
    wire = listen()
    wire.link.send(b"nobody is there")
    first = dial(wire)
    assert wire.ups == [True]
    first.sendall(b"one")
    wire.loop.until(lambda: wire.data == b"one")
    wire.link.send(b"two")
    assert first.recv(100) == b"two"
    first.close()
    wire.loop.until(lambda: wire.ups == [True, False])
    second = dial(wire)
    assert wire.ups == [True, False, True]
    wire.link.send(b"three")
    assert second.recv(100) == b"three"
    wire.link.close()
    assert second.recv(100) == b""
    second.close()


def test_a_second_caller_is_turned_away_and_the_first_keeps_the_line():
    wire = listen()
    first, second = dial(wire), dial(wire)
    second.settimeout(PATIENCE_S)
    assert second.recv(100) == b""
    first.sendall(b"still here")
    wire.loop.until(lambda: wire.data == b"still here")
    assert wire.ups == [True]
    for peer in (first, second):
        peer.close()
    wire.link.close()


def test_a_peer_that_does_not_read_gets_no_old_frames_beyond_its_own_buffers(router):
    """What the network has taken cannot be taken back; ours holds back no more than a few frames, and tears none."""
    wire = call(router.port)
    peer = router.accept()
    packer = Packer(1, 191)
    frames = [packer.pack("SYSTEM_TIME", time_unix_usec=2**60 + i, time_boot_ms=2**30) * 20 for i in range(40_000)]
    for frame in frames:
        wire.link.send(frame)
    assert wire.link.send_errors > 0
    splitter = Splitter()
    peer.settimeout(0.2)
    got = 0
    try:
        while data := peer.recv(1 << 20):
            got += len(splitter.feed(data, whole=False))
    except TimeoutError:
        wire.link.send(frames[0])
        got += len(splitter.feed(peer.recv(1 << 20), whole=False))
    assert got > 20 and splitter.counts.bad_crc == 0 and splitter.counts.rubbish_bytes == 0
    wire.link.close()
    peer.close()


def test_why_a_link_does_not_open(router):
    with pytest.raises(LinkError, match="the port is in use"):
        open_link(parse(f"tcpin://127.0.0.1:{router.port}"))
    router.listener.close()
    with pytest.raises(LinkError, match="nobody answers there"):
        call(router.port)
    with pytest.raises(LinkError, match=r"host name 'no\.such\.host\.invalid' is not known"):
        open_link(parse("tcpout://no.such.host.invalid:5760"))
