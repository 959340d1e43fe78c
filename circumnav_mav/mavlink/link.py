"""The app's end of a MAVLink link to an autopilot, SANS-IO: bytes in, messages out; what to send, when it is due.

Identity: the vehicle's system id (1 until it is configured or heard), component 191, MAV_TYPE_ONBOARD_CONTROLLER, so
that nobody takes the app for a ground station.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from math import isnan, nan
from struct import pack, unpack
from typing import Any

from circumnav_mav.mavlink import px4_modes
from circumnav_mav.mavlink.announcer import Announcer
from circumnav_mav.mavlink.autopilot import AUTOPILOT_COMPONENT, Autopilot
from circumnav_mav.mavlink.codec import Decoder, Frame, Message, Packer, Splitter
from circumnav_mav.mavlink.commands import Command, CommandQueue
from circumnav_mav.mavlink.dialect import by_name, enums
from circumnav_mav.mavlink.modes import ModeWords
from circumnav_mav.mavlink.offboard import Authority, Control, ModeRequest, Seen
from circumnav_mav.mavlink.signing import Signer
from circumnav_mav.mavlink.streams import WANTED_HZ, interval_us, unwanted
from circumnav_mav.mavlink.timesync import TimeSync

COMPANION_COMPONENT = 191
HEARTBEAT_S = 1.0
ASK_MODE_S = 0.1
"""While the mode is not known, it is asked for so often: PX4 gives up a silent companion after about a second."""
OVERDUE_S, ASK_OVERDUE_S = 1.2, 0.2
"""An ArduPilot tells its mode once a second: after so long that message was lost, and is asked for, so often."""
NEED_HZ = 1.0
"""Rate to ask for what a vehicle class needs to hear, without flying on it."""
PARAM_INT32 = 6
LET_GO = frozenset({Control.RELEASED, Control.GIVEN_BACK})
COMMANDS = frozenset({"COMMAND_LONG", "COMMAND_INT"})
SETPOINTS = frozenset({"SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT", "SET_ATTITUDE_TARGET"})
OWN_MESSAGES = ("COMMAND_ACK", *COMMANDS, "TIMESYNC", "PARAM_VALUE", "STATUSTEXT", *SETPOINTS)


class AutopilotLink:
    """One link. `frames` of the last `receive` are kept for the recorder."""

    def __init__(
        self,
        subscribed: Collection[str],
        wanted_hz: Mapping[str, float] = WANTED_HZ,
        words: ModeWords = px4_modes.WORDS,
        signer: Signer | None = None,
        *,
        system_id: int | None = None,
    ) -> None:
        self.autopilot = Autopilot(system_id)
        self.words = words
        self.authority = Authority(self.autopilot, words)
        self.commands = CommandQueue()
        self.time = TimeSync()
        self.parameters: dict[str, float] = {}
        self.latch_commands = 0
        """How often MAV_CMD_USER_1 came for this component: the operator's wish to be followed again."""
        self.autopilot_texts: list[str] = []
        self._wanted_hz = wanted_hz
        read = {*self.autopilot.messages, *OWN_MESSAGES, *subscribed}
        self._splitter = Splitter(read)
        self._decoder = Decoder(read)
        self._packer = Packer(system_id or 1, COMPANION_COMPONENT, signer)
        self.announce = Announcer(self._packer, self.autopilot)
        self.signer = signer
        self.signs_at_us = False
        """Whether the autopilot signs and we have no key: it will not listen."""
        self._heartbeat_next_s = nan
        self._ask_mode_next_s = nan
        self._asked_s: dict[int, float] = {}
        """When each TIMESYNC of ours that has not been answered was sent, by what it carries."""
        self._set_up_for: tuple[int | None, int] = (None, 0)
        self.counts = self._splitter.counts
        self.autopilot_spoke = False
        """Whether the bytes taken in last held a message of the autopilot that is believed."""
        self._heard_s = nan
        """When one came last."""
        self._silence_taken_in = False
        self._theirs_alone = frozenset(self.autopilot.messages) - set(subscribed)
        self._handlers: dict[str, Callable[[Any, float], None]] = {
            "HEARTBEAT": self._on_mode,
            "CURRENT_MODE": self._on_mode,
            "COMMAND_ACK": self._on_ack,
            "PARAM_VALUE": self._on_parameter,
            "STATUSTEXT": self._on_text,
            "TIMESYNC": self._on_timesync,
        }

    def receive(self, data: bytes, now_s: float, *, whole: bool = True) -> tuple[list[Frame], list[Message]]:
        """Take in bytes; return all frames (for the recorder) and the messages that are not the link's own business."""
        frames = self._splitter.feed(data, whole=whole)
        others = []
        self.autopilot_spoke = False
        decode, autopilot, handlers = self._decoder.decode, self.autopilot, self._handlers
        signer = self.signer
        if signer is not None:
            signer.advance(now_s)
        for frame in frames:
            message = decode(frame)
            if message is None:
                continue
            if signer is not None:
                if not signer.believes(frame.raw, frame.sysid, frame.compid):
                    continue
            elif frame.signed and frame.compid == AUTOPILOT_COMPONENT:
                self.signs_at_us = True
            name = message[0]
            if autopilot.on_message(message, now_s):
                self.autopilot_spoke = True
                self._heard_s, self._silence_taken_in = now_s, False
                if autopilot.reboots != self._reboots:
                    self._reboots = autopilot.reboots
                    self.authority.lost("the autopilot has restarted")
                    self.time.forget()
                handler = handlers.get(name)
                if handler is not None:
                    handler(message.fields, now_s)
                if name in self._theirs_alone:
                    continue
            elif name in COMMANDS:
                self._command_for_us(message)
                continue
            elif name == "HEARTBEAT" or name in SETPOINTS:
                self._watch_rivals(message, now_s)
                continue
            if name == "TIMESYNC" and message.fields.tc1:
                self.time.answer((message.sysid, message.compid), message.fields.ts1, message.fields.tc1, now_s)
            if name not in OWN_MESSAGES:
                others.append(message)
        self.counts.decoded = self._decoder.decoded
        return frames, others

    def _on_mode(self, fields: Any, now_s: float) -> None:
        self.authority.on_mode(now_s)

    def _on_ack(self, fields: Any, now_s: float) -> None:
        if self._for_us(fields):
            self.commands.on_ack(fields.command, fields.result)

    def _on_text(self, fields: Any, now_s: float) -> None:
        self.autopilot_texts.append(fields.text.split(b"\0")[0].decode("utf-8", "replace").strip())

    def _on_timesync(self, fields: Any, now_s: float) -> None:
        if fields.tc1 == 0:
            self._timesync = fields.ts1
        elif (asked_s := self._asked_s.get(fields.ts1)) is not None:
            self._asked_s.clear()  # one answer will do: a later one, or the same again, would say less
            self.authority.answered(now_s, asked_s)

    _timesync: int | None = None
    _reboots: int = 0
    _latch_asked_by: tuple[int, int] = (0, 0)

    def _watch_rivals(self, message: Message, now_s: float) -> None:
        """Our own frames never come back to us: what speaks as we do, or flies what we fly, is somebody else."""
        vehicle = self._packer.sysid
        who = f"system {message.sysid} component {message.compid}"
        if message.name in SETPOINTS:
            if message.fields.target_system in (0, vehicle) and self.autopilot.sysid is not None:
                self.authority.rival(now_s, who, flies=True)
        elif (message.sysid, message.compid) == (vehicle, COMPANION_COMPONENT):
            self.authority.rival(now_s, who, flies=False)

    def _for_us(self, fields: Any) -> bool:
        return fields.target_system in (0, self._packer.sysid) and fields.target_component in (0, COMPANION_COMPONENT)

    def _command_for_us(self, message: Message) -> None:
        fields = message.fields
        if fields.command == enums.MAV_CMD_USER_1 and self._for_us(fields) and fields.target_component:
            self.latch_commands += 1
            self._latch_asked_by = (message.sysid, message.compid)

    def _on_parameter(self, fields: Any, now_s: float) -> None:
        name = fields.param_id.split(b"\0")[0].decode("ascii", "replace")
        value = fields.param_value
        if fields.param_type == PARAM_INT32 and self.autopilot.kind == enums.MAV_AUTOPILOT_PX4:
            (value,) = unpack("<i", pack("<f", value))  # PX4 sends an integer's bytes in the float field
        self.parameters[name] = float(value)
        if name == self.words.loss_parameter and value > 0:
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
        requests = self.authority.poll(now_s)  # may notice that the aircraft is no longer ours: before the commands
        self._let_go()
        self._set_up()
        if self._timesync is not None:
            due.append(self._packer.pack("TIMESYNC", tc1=int(now_s * 1e9), ts1=self._timesync))
            self._timesync = None
        if (token := self.time.question(now_s)) is not None:
            due.append(self._packer.pack("TIMESYNC", tc1=0, ts1=token))
        due += [self._command(command) for command in self.commands.poll(now_s)]
        if self.authority.seen() is Seen.NOTHING and not now_s < self._ask_mode_next_s:
            due += self._ask_mode(now_s)  # the last answer may have been lost
        elif self._mode_overdue(now_s) and not now_s < self._ask_mode_next_s:
            self._ask_mode_next_s = now_s + ASK_OVERDUE_S
            due.append(self._request_mode())
        due += [self._mode(request) for request in requests]
        return due

    def _let_go(self) -> None:
        """Once the aircraft is somebody else's, send no command that waited; streams among them are asked for later.

        A restarted autopilot or a new connection is asked for its streams all the same: without them nobody tells the
        mode.
        """
        let_go, before = self.authority.control in LET_GO, self._has_let_go
        self._has_let_go = let_go
        if let_go and not before:
            self._set_up_late = self.commands.clear()
        elif before and not let_go and self._set_up_late:
            self._set_up_for, self._set_up_late = (None, 0), False

    _has_let_go: bool = False
    _set_up_late: bool = False

    def setpoint(self, name: str, fields: dict[str, Any], now_s: float) -> bytes:
        """Return the frame of an encoded setpoint; it counts as sent."""
        self.authority.sent(now_s)
        return self._packer.pack(name, **fields, **self._target())

    def after_gap(self, now_s: float) -> list[bytes]:
        """The app was away: believe nothing sent before now; return what finds out the mode soon."""
        self.authority.gap(now_s)
        self.authority.await_answer(now_s)
        self._asked_s.clear()
        return self._ask_mode(now_s)

    def fell_silent(self, now_s: float) -> bool:
        """Return whether setpoints leave into a silence that `after_silence` has not been told of."""
        return not self._silence_taken_in and self.authority.silent(now_s, self._heard_s)

    def after_silence(self, now_s: float) -> list[bytes]:
        """The autopilot fell silent: as after a gap, which began when it was last heard."""
        self._silence_taken_in = True
        self.authority.cut_off(self._heard_s)
        return self.after_gap(now_s)

    def _ask_mode(self, now_s: float) -> list[bytes]:
        """Return a question whose answer dates what follows it, and a request for the message that shows the mode.

        Nothing before an autopilot is known: the poll asks then.
        """
        if self.autopilot.sysid is None:
            return []
        self._ask_mode_next_s = now_s + ASK_MODE_S
        token = int(now_s * 1e9)
        self._asked_s[token] = now_s
        dated = self._packer.pack("TIMESYNC", tc1=0, ts1=token)
        return [dated, self._request_mode()]

    def _mode_overdue(self, now_s: float) -> bool:
        """Whether the autopilot speaks, but has not told its mode when it should have."""
        ap = self.autopilot
        return now_s - ap.mode_s > OVERDUE_S and now_s - ap.heard_s.get("ATTITUDE", nan) < OVERDUE_S / 2

    def _request_mode(self) -> bytes:
        request = (float(by_name("CURRENT_MODE" if self.words.tells_intention else "HEARTBEAT").msgid),)
        return self._command(Command(enums.MAV_CMD_REQUEST_MESSAGE, request + (0.0,) * 6, "mode"))

    def reconnected(self, now_s: float) -> list[bytes]:
        """The link was lost and is back: set it up again, its settings went with it; then as after any gap."""
        self.time.forget()
        self._set_up_for = (None, 0)
        return self.after_gap(now_s)

    def answer_latch(self, opened: bool) -> bytes:
        """Return the COMMAND_ACK for the operator's MAV_CMD_USER_1."""
        system, component = self._latch_asked_by
        return self._packer.pack(
            "COMMAND_ACK",
            command=enums.MAV_CMD_USER_1,
            result=enums.MAV_RESULT_ACCEPTED if opened else enums.MAV_RESULT_TEMPORARILY_REJECTED,
            progress=0,
            result_param2=0,
            target_system=system,
            target_component=component,
        )

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
        self.ask_for(self._wanted_hz)
        for name in unwanted(self.autopilot.kind, self._wanted_hz):
            self._ask_for(name, 0.0)

    def ask_for(self, names: Iterable[str]) -> None:
        """Ask for streams of the vehicle class, at their rates."""
        for name in names:
            self._ask_for(name, self._wanted_hz.get(name, NEED_HZ))

    def _ask_for(self, name: str, rate_hz: float) -> None:
        self.commands.push(
            enums.MAV_CMD_SET_MESSAGE_INTERVAL,
            float(by_name(name).msgid),
            interval_us(rate_hz),
            purpose=f"{name} at {rate_hz:g} Hz" if rate_hz else f"{name} off",
        )

    def _target(self) -> dict[str, int]:
        return {"target_system": self.autopilot.sysid or 1, "target_component": AUTOPILOT_COMPONENT}

    def _command(self, command: Command) -> bytes:
        if command.frame is not None:
            return self._command_int(command, command.frame)
        params = {f"param{i}": value for i, value in enumerate(command.params, 1)}
        return self._packer.pack("COMMAND_LONG", command=command.command, confirmation=0, **params, **self._target())

    def _command_int(self, command: Command, frame: int) -> bytes:
        *params, x, y, z = command.params
        fields = {f"param{i}": value for i, value in enumerate(params, 1)}
        fields |= {"x": int(x), "y": int(y), "z": z, "frame": frame, "current": 0, "autocontinue": 0}
        return self._packer.pack("COMMAND_INT", command=command.command, **fields, **self._target())

    def _mode(self, request: ModeRequest) -> bytes:
        main, sub = self.words.split(request.custom_mode)
        params = (float(enums.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED), float(main), float(sub), 0.0, 0.0, 0.0, 0.0)
        return self._command(Command(enums.MAV_CMD_DO_SET_MODE, params, "mode"))

    def read_parameters(self, now_s: float) -> list[bytes]:
        """Return the requests for the parameters that are still missing, at most once a second."""
        missing = [name for name in self.words.parameters if name not in self.parameters]
        if not missing or self.autopilot.sysid is None or now_s < self._parameters_next_s:
            return []
        if self.authority.control in LET_GO:
            return []
        self._parameters_next_s = now_s + 1.0 if isnan(self._parameters_next_s) else now_s + 5.0
        return [
            self._packer.pack("PARAM_REQUEST_READ", param_id=name.encode(), param_index=-1, **self._target())
            for name in missing
        ]

    _parameters_next_s: float = nan
