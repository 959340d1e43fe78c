"""The process that MAVSDK lives in: frames from the app leave as MAVSDK's messages, the vehicle's come back as frames.

    python -m circumnav_mav.runtime.mavsdk_child URL FD SYSTEM_ID

SYSTEM_ID: the vehicle to fly, 0 for the first one heard. MAVSDK's own system id is the vehicle's, as the app's is: it
must be given before a connection is made, so a vehicle with another one than 1 costs a second start.

Setpoints go through mavlink_direct, which sends a message once. MAVSDK's offboard plugin re-sends the last one at 20 Hz
from a thread of its own: with Python dead, too, and in a burst where the process was held up; it would have to be
destroyed whenever the app falls silent. As it is, the app's silence is silence on the wire. A closed FD ends it all.
"""

from __future__ import annotations

import asyncio
import json
import math
import socket
import struct
import sys
import time
from collections import Counter
from typing import Any

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.exceptions import MavsdkConnectionError
from mavsdk.logging import LogLevel, log_subscribe
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectError, MavlinkMessage

from circumnav_mav.mavlink.codec import Decoder, Message, Packer, Splitter
from circumnav_mav.mavlink.dialect import by_name
from circumnav_mav.mavlink.link import SETPOINTS
from circumnav_mav.runtime.mavsdk_link import STAMP

OLD_S = 0.1
"""What waited for longer than this is dropped: old words may not take an aircraft back, whoever was held up."""
FIND_S = 0.1
FRAME = 4096
COMPONENT = 191
EXIT_LINK = 3
SENT = frozenset(
    {
        *SETPOINTS,
        *("COMMAND_LONG", "COMMAND_INT", "COMMAND_ACK", "PARAM_REQUEST_READ", "TIMESYNC", "STATUSTEXT"),
        *("ORBIT_EXECUTION_STATUS", "DEBUG_VECT", "DEBUG_FLOAT_ARRAY"),
    }
)
"""What goes out. The HEARTBEAT is MAVSDK's own."""


class Child:
    """One MAVSDK after another, for as long as the app is there."""

    def __init__(self, url: str, pair: socket.socket, system_id: int) -> None:
        self._url, self._pair = url, pair
        self._wanted = system_id
        self._sysid = system_id or 1
        self._splitter, self._decoder = Splitter(SENT), Decoder(SENT)
        self._packers: dict[tuple[int, int], Packer] = {}
        self._direct: Any = None
        self._end = asyncio.Event()
        self.dropped: Counter[str] = Counter()

    async def run(self) -> None:
        """Serve until the app is gone."""
        asyncio.get_running_loop().add_reader(self._pair.fileno(), self._read)
        while not self._end.is_set():
            await self._session()

    def _read(self) -> None:
        """Send what the app gave."""
        while True:
            try:
                data = self._pair.recv(FRAME)
            except BlockingIOError:
                break
            except OSError:
                data = b""
            if not data:
                asyncio.get_running_loop().remove_reader(self._pair.fileno())
                self._end.set()
                break
            (given_s,) = STAMP.unpack_from(data)
            for frame in self._splitter.feed(data[STAMP.size :], whole=True):
                message = self._decoder.decode(frame)
                if message is not None and self._direct is not None and time.monotonic() - given_s < OLD_S:
                    self._send(message)

    def _send(self, message: Message) -> None:
        try:
            self._direct.send_message(to_mavsdk(message))
        except MavlinkDirectError:
            self.dropped[message.name] += 1

    async def _session(self) -> None:
        config = Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER)
        config.system_id, config.component_id = self._sysid, COMPONENT
        sdk = Mavsdk(config)
        try:
            await sdk.add_any_connection(self._url)
            found = await self._find(sdk)
            if found is None or found[0] != config.system_id:
                return  # nobody, or one whose id ours must be first
            system = found[1]
            direct = MavlinkDirect(system._system)
            handle = direct.subscribe_message("", self._from_vehicle)
            self._direct = direct
            await self._end.wait()
            self._direct = None
            direct.unsubscribe_message(handle)
            direct.destroy()
        finally:
            sdk.destroy()

    async def _find(self, sdk: Any) -> tuple[int, Any] | None:
        """Return (system id, system) of the vehicle to fly as soon as it is heard, and be of that id from now on."""
        while not self._end.is_set():
            for system in await sdk.get_systems():
                sysid = await system.get_system_id()
                if await system.has_autopilot() and self._wanted in (0, sysid):
                    self._sysid = sysid
                    return sysid, system
            await asyncio.sleep(FIND_S)
        return None

    def _from_vehicle(self, message: Any, _: Any) -> None:
        """Hand a message to the app as a frame. Runs in MAVSDK's thread; a frame that does not fit is dropped."""
        source = (message.system_id, message.component_id)
        packer = self._packers.get(source)
        if packer is None:
            packer = self._packers[source] = Packer(*source)
        try:
            fields = fields_of(message.message_name, json.loads(message.fields_json))
            self._pair.send(packer.pack(message.message_name, **fields))
        except (KeyError, ValueError, TypeError, ArithmeticError, OSError, struct.error):
            self.dropped[message.message_name] += 1


def to_mavsdk(message: Message) -> Any:
    """Return a decoded message as mavlink_direct takes it."""
    fields = {name: _json(value) for name, value in message.fields._asdict().items()}
    target = (fields.get("target_system", 0), fields.get("target_component", 0))
    return MavlinkMessage(message.name, message.sysid, message.compid, *target, json.dumps(fields))


def _json(value: Any) -> Any:
    if isinstance(value, bytes):
        return value.split(b"\0")[0].decode("ascii", "replace")
    if isinstance(value, tuple):
        return [_json(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def fields_of(name: str, said: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of a message as the codec packs them; what MAVSDK does not say is 0. KeyError: not known."""
    shape = by_name(name)
    return {
        field: _field(said.get(field, 0), length) for field, length in zip(shape.fields, shape.lengths, strict=True)
    }


def _field(value: Any, length: int) -> Any:
    if isinstance(value, str):
        return value.encode("ascii", "replace")
    if length > 1:
        values = [_field(v, 1) for v in value] if isinstance(value, list) else []
        return tuple(values + [0] * (length - len(values)))
    return math.nan if value is None else value


def main() -> None:
    """Run the child. MAVSDK's chatter is kept from the terminal; its warnings are not."""
    log_subscribe(lambda level, *_: level < LogLevel.WARN)
    pair = socket.socket(fileno=int(sys.argv[2]))
    pair.setblocking(False)
    try:
        asyncio.run(Child(sys.argv[1], pair, int(sys.argv[3])).run())
    except MavsdkConnectionError as error:
        print(f"circumnav: {sys.argv[1]}: MAVSDK does not open it: {error}", file=sys.stderr)
        sys.exit(EXIT_LINK)


if __name__ == "__main__":
    main()
