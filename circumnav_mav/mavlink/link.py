"""The app's end of a MAVLink link to an autopilot, SANS-IO: bytes in, messages out; what to send, when it is due.

Identity: the vehicle's system id (1 until it is heard), component 191, MAV_TYPE_ONBOARD_CONTROLLER, so that nobody
takes the app for a ground station.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import isnan, nan
from struct import pack, unpack
from typing import Any

from circumnav_mav.mavlink import px4_modes
from circumnav_mav.mavlink.autopilot import AUTOPILOT_COMPONENT, MODE_MESSAGES, Autopilot
from circumnav_mav.mavlink.codec import Decoder, Frame, Message, Packer, Splitter
from circumnav_mav.mavlink.commands import Command, CommandQueue
from circumnav_mav.mavlink.dialect import by_name, enums
from circumnav_mav.mavlink.offboard import Authority, ModeRequest
from circumnav_mav.mavlink.signing import Signer
from circumnav_mav.mavlink.streams import UNWANTED, WANTED_HZ, interval_us

COMPANION_COMPONENT = 191
HEARTBEAT_S = 1.0
PARAMETERS = ("COM_OF_LOSS_T", "COM_OBL_RC_ACT")
"""What the app reads of the autopilot's settings: when and how it acts if the setpoints stop."""
PARAM_INT32 = 6
STATUSTEXT_LENGTH = 50
OWN_MESSAGES = ("COMMAND_ACK", "COMMAND_LONG", "COMMAND_INT", "TIMESYNC", "PARAM_VALUE", "STATUSTEXT")


class AutopilotLink:
    """One link. `frames` of the last `receive` are kept for the recorder."""

    def __init__(
        self,
        subscribed: Iterable[str],
        wanted_hz: dict[str, float] | None = None,
        signer: Signer | None = None,
    ) -> None:
        self.autopilot = Autopilot()
        self.authority = Authority(self.autopilot)
        self.commands = CommandQueue()
        self.parameters: dict[str, float] = {}
        self.latch_commands = 0
        """How often MAV_CMD_USER_1 came for this component: the operator's wish to be followed again."""
        self.autopilot_texts: list[str] = []
        self._wanted_hz = WANTED_HZ | (wanted_hz or {})
        self._splitter = Splitter()
        self._decoder = Decoder({*self.autopilot.messages, *OWN_MESSAGES, *subscribed})
        self._packer = Packer(1, COMPANION_COMPONENT, signer)
        self.signer = signer
        self.signs_at_us = False
        """Whether the autopilot signs and we have no key: it will not listen."""
        self._heartbeat_next_s = nan
        self._set_up_for: tuple[int | None, int] = (None, 0)
        self.counts = self._splitter.counts

    def receive(self, data: bytes, now_s: float, *, whole: bool = True) -> tuple[list[Frame], list[Message]]:
        """Take in bytes; return all frames (for the recorder) and the messages that are not the link's own business."""
        frames = self._splitter.feed(data, whole=whole)
        others = []
        signer = self.signer
        if signer is not None:
            signer.advance(now_s)
        for frame in frames:
            if signer is not None and not signer.believes(frame.raw, frame.sysid, frame.compid):
                continue
            message = self._decoder.decode(frame)
            if message is None:
                continue
            if signer is None and frame.signed and frame.compid == AUTOPILOT_COMPONENT:
                self.signs_at_us = True
            self.counts.decoded += 1
            if not self._own(message, now_s):
                others.append(message)
        return frames, others

    def _own(self, message: Message, now_s: float) -> bool:
        fields = message.fields
        if message.name in ("COMMAND_LONG", "COMMAND_INT"):
            self._command_for_us(message)
            return True
        if not self.autopilot.on_message(message, now_s):
            return message.name in OWN_MESSAGES
        if message.name in MODE_MESSAGES:
            self.authority.on_mode(now_s)
        elif message.name == "COMMAND_ACK":
            if self._for_us(fields):
                self.commands.on_ack(fields.command, fields.result)
        elif message.name == "PARAM_VALUE":
            self._parameter(fields)
        elif message.name == "STATUSTEXT":
            self.autopilot_texts.append(fields.text.split(b"\0")[0].decode("utf-8", "replace").strip())
        elif message.name == "TIMESYNC" and fields.tc1 == 0:
            self._timesync = fields.ts1
        return message.name in OWN_MESSAGES or message.name in self.autopilot.messages

    _timesync: int | None = None

    def _for_us(self, fields: Any) -> bool:
        return fields.target_system in (0, self._packer.sysid) and fields.target_component in (0, COMPANION_COMPONENT)

    def _command_for_us(self, message: Message) -> None:
        fields = message.fields
        if fields.command == enums.MAV_CMD_USER_1 and self._for_us(fields) and fields.target_component:
            self.latch_commands += 1

    def _parameter(self, fields: Any) -> None:
        name = fields.param_id.split(b"\0")[0].decode("ascii", "replace")
        value = fields.param_value
        if fields.param_type == PARAM_INT32 and self.autopilot.kind == enums.MAV_AUTOPILOT_PX4:
            (value,) = unpack("<i", pack("<f", value))  # PX4 sends an integer's bytes in the float field
        self.parameters[name] = float(value)
        if name == "COM_OF_LOSS_T" and value > 0:
            self.authority.loss_timeout_s = float(value)

    def poll(self, now_s: float) -> list[bytes]:
        """Return the frames that are due: heartbeat, answers, commands, mode requests."""
        due: list[bytes] = []
        if self.signer is not None:
            self.signer.advance(now_s)
        if not now_s < self._heartbeat_next_s:
            self._heartbeat_next_s = now_s + HEARTBEAT_S
            due.append(self._heartbeat())
        if self.autopilot.sysid is None:
            return due
        self._packer.sysid = self.autopilot.sysid
        self._set_up()
        if self._timesync is not None:
            due.append(self._packer.pack("TIMESYNC", tc1=int(now_s * 1e9), ts1=self._timesync))
            self._timesync = None
        due += [self._command(command) for command in self.commands.poll(now_s)]
        due += [self._mode(request) for request in self.authority.poll(now_s)]
        return due

    def setpoint(self, name: str, fields: dict[str, Any], now_s: float) -> bytes:
        """Return the frame of an encoded setpoint; it counts as sent."""
        self.authority.sent(now_s)
        return self._packer.pack(name, **fields, **self._target())

    def after_gap(self, now_s: float) -> bytes:
        """The app was away: believe nothing older than now; return a request for the mode, so as to know it soon."""
        self.authority.gap(now_s)
        request = (float(by_name("CURRENT_MODE").msgid),)
        return self._command(Command(enums.MAV_CMD_REQUEST_MESSAGE, request + (0.0,) * 6, "mode"))

    def reconnected(self, now_s: float) -> bytes:
        """The link was lost and is back: set it up again, its settings went with it; then as after any gap."""
        self._set_up_for = (None, 0)
        return self.after_gap(now_s)

    def statustext(self, text: str, severity: int) -> bytes:
        """Return a STATUSTEXT for the ground station; the autopilot forwards it."""
        cut = text.encode("ascii", "replace")[:STATUSTEXT_LENGTH]
        return self._packer.pack("STATUSTEXT", severity=severity, text=cut, id=0, chunk_seq=0)

    def _heartbeat(self) -> bytes:
        return self._packer.pack(
            "HEARTBEAT",
            type=enums.MAV_TYPE_ONBOARD_CONTROLLER,
            autopilot=enums.MAV_AUTOPILOT_INVALID,
            base_mode=0,
            custom_mode=0,
            system_status=enums.MAV_STATE_ACTIVE,
            mavlink_version=3,
        )

    def _set_up(self) -> None:
        """Ask for streams and parameters, once an autopilot and again after its restart."""
        state = (self.autopilot.sysid, self.autopilot.reboots)
        if state == self._set_up_for:
            return
        self._set_up_for = state
        self.commands.clear()
        for name, rate_hz in {**self._wanted_hz, **dict.fromkeys(set(UNWANTED) - set(self._wanted_hz), 0.0)}.items():
            self.commands.push(
                enums.MAV_CMD_SET_MESSAGE_INTERVAL,
                float(by_name(name).msgid),
                interval_us(rate_hz),
                purpose=f"{name} at {rate_hz:g} Hz" if rate_hz else f"{name} off",
            )

    def _target(self) -> dict[str, int]:
        return {"target_system": self.autopilot.sysid or 1, "target_component": AUTOPILOT_COMPONENT}

    def _command(self, command: Command) -> bytes:
        params = {f"param{i}": value for i, value in enumerate(command.params, 1)}
        return self._packer.pack("COMMAND_LONG", command=command.command, confirmation=0, **params, **self._target())

    def _mode(self, request: ModeRequest) -> bytes:
        main, sub = px4_modes.main_and_sub(request.custom_mode)
        params = (float(enums.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(main), float(sub), 0.0, 0.0, 0.0, 0.0)
        return self._command(Command(enums.MAV_CMD_DO_SET_MODE, params, "mode"))

    def read_parameters(self, now_s: float) -> list[bytes]:
        """Return the requests for the parameters that are still missing, at most once a second."""
        missing = [name for name in PARAMETERS if name not in self.parameters]
        if not missing or self.autopilot.sysid is None or now_s < self._parameters_next_s:
            return []
        self._parameters_next_s = now_s + 1.0 if isnan(self._parameters_next_s) else now_s + 5.0
        return [
            self._packer.pack("PARAM_REQUEST_READ", param_id=name.encode(), param_index=-1, **self._target())
            for name in missing
        ]

    _parameters_next_s: float = nan
