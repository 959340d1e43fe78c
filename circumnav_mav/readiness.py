"""What would stop a flight, or make its end worse than it need be: an audit of a live link, SANS-IO. It moves nothing.

`circumnav check CONFIG --live` listens for ten seconds; every finding names what it looked at and what mends it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from math import isnan

from circumnav_mav.config import Config
from circumnav_mav.mavlink.autopilot import AUTOPILOT_COMPONENT
from circumnav_mav.mavlink.codec import Frame, Packer
from circumnav_mav.mavlink.dialect import by_name, enums
from circumnav_mav.mavlink.link import COMPANION_COMPONENT, AutopilotLink
from circumnav_mav.mavlink.signing import Signer
from circumnav_mav.mavlink.vehicles import VEHICLES
from circumnav_mav.mavlink.vehicles.fitness import Fitness, Unfit, described
from circumnav_mav.range_feed import RangeFeed
from circumnav_mav.range_words import commonest
from circumnav_mav.settings_check import Finding, Severity, facts, judged
from circumnav_mav.settings_table import TABLES, asked
from circumnav_mav.types import RangeSample

RC_RECEIVER, PREARM_CHECK = enums.MAV_SYS_STATUS_SENSOR_RC_RECEIVER, enums.MAV_SYS_STATUS_PREARM_CHECK
STICKS = frozenset({by_name("RC_CHANNELS").msgid, by_name("MANUAL_CONTROL").msgid})
SLOW_SHARE = 0.5
"""A stream below this share of what was asked for is slow."""
SETTLE_S = 3.0
"""Streams are counted from here on: first they must be asked for."""
LEAST_RANGE_HZ = 2.0


class Audit:
    """Feed it what arrives, send what `tick` returns, and ask for the findings at the end."""

    def __init__(self, config: Config, signer: Signer | None = None) -> None:
        self._config = config
        self._vehicle = vehicle = config.vehicle_class
        self.ranges = RangeFeed(config.ranging)
        words = replace(vehicle.words, parameters=asked(vehicle.name))
        subscribed = () if self.ranges.own_link else self.ranges.messages
        self.link = AutopilotLink(subscribed, vehicle.messages_hz, words, signer, system_id=config.vehicle.system_id)
        self.link.authority.needs_air = vehicle.airframe != "rover"
        self.ranges.follow_clocks(self.link.time)
        self._to_radio = Packer(config.vehicle.system_id or 1, COMPANION_COMPONENT)
        self._fitness = Fitness(vehicle, VEHICLES.values())
        self._counts: Counter[int] = Counter()
        self._sticks = False
        self._accepted = 0
        self._decoys = 0
        self._since_s = SETTLE_S

    def receive(self, data: bytes, now_s: float, *, ranging: bool = False, whole: bool = True) -> bool:
        """Take in what arrived at `now_s`; return whether it came from whom that link is to speak to.

        ranging: on the radio's own link, which is not signed.
        """
        frames: list[Frame] = []
        if ranging:
            _, results = self.ranges.on_bytes(data, now_s, whole=whole)
        else:
            frames, messages = self.link.receive(data, now_s, whole=whole)
            self.ranges.on_vehicle(self.link.autopilot.sysid, moving=False)
            results = [] if self.ranges.own_link else self.ranges.on_messages(messages, now_s)
            for frame in frames:
                self._sticks = self._sticks or frame.msgid in STICKS
                if now_s >= self._since_s and frame.compid == AUTOPILOT_COMPONENT:
                    self._counts[frame.msgid] += 1
        for result in results:
            if not isinstance(result, RangeSample):
                self._decoys += str(result.reason) in ("wrong_source", "decoy_orientation")
            elif now_s >= self._since_s:
                self._accepted += 1
        if ranging:
            return any(isinstance(result, RangeSample) for result in results)
        return self.link.autopilot_spoke

    def tick(self, now_s: float) -> list[bytes]:
        """Return what is to be sent: heartbeat, requests for streams and parameters. Never a setpoint, never a mode."""
        return self.link.poll(now_s) + self.link.read_parameters(now_s)

    def questions(self, now_s: float) -> list[bytes]:
        """Return what is to be sent on the radio's own link: TIMESYNC alone."""
        self._to_radio.sysid = self.link.autopilot.sysid or self._to_radio.sysid
        return self.ranges.questions(now_s, self._to_radio)

    def findings(self, now_s: float) -> list[Finding]:
        """Return the table, gravest first."""
        if self.link.autopilot.sysid is None:
            found = [self._nobody(), *self._range(now_s)]
        else:
            unfit = self._fitness.unfit(self.link.autopilot, now_s)
            other_vehicle = unfit is not None and unfit.final
            found = [
                *self._vehicle_rows(now_s, unfit),
                *self._streams(now_s),
                *self._range(now_s),
                *([] if other_vehicle else self._settings()),  # which belong to another autopilot, or airframe
                *self._pilot(),
                *self._battery(),
            ]
        return sorted(found, key=lambda finding: -finding.severity)

    # -- rows -------------------------------------------------------------------------------------------------------

    def _nobody(self) -> Finding:
        counts, link = self.link.counts, self._config.vehicle.link
        fix = f"check vehicle.link ({link}), the cable, and that MAV_x_CONFIG of that port is set"
        if others := sorted(self.link.autopilot.strangers):
            wanted = f"not vehicle.system_id = {self._config.vehicle.system_id}"
            text = f"{', '.join(f'system {n}' for n in others)} is heard, but {wanted}"
            return Finding(Severity.ERROR, "autopilot", text, "set vehicle.system_id to the vehicle to fly, or null")
        if counts.understood:
            return Finding(
                Severity.ERROR,
                "autopilot",
                "MAVLink comes, but no autopilot's HEARTBEAT (component 1)",
                "check routing",
            )
        if counts.noise or counts.rubbish_bytes:
            return Finding(Severity.ERROR, "autopilot", "bytes come that are not MAVLink", f"baud rate? {fix}")
        return Finding(Severity.ERROR, "autopilot", "nothing is heard", fix)

    def _vehicle_rows(self, now_s: float, unfit: Unfit | None) -> Iterator[Finding]:
        ap, authority = self.link.autopilot, self.link.authority
        who = f"system {ap.sysid}, {described(ap.kind, ap.vehicle_type)}"
        if unfit is not None:
            yield Finding(Severity.ERROR, "vehicle", unfit.text)
        else:
            yield Finding(Severity.OK, "vehicle", who)
        if self.link.signs_at_us:
            yield Finding(Severity.ERROR, "signing", "the autopilot signs its messages", "set vehicle.signing_key_file")
        for stranger in sorted(ap.strangers):
            fix = f"set vehicle.system_id to {ap.sysid} (or {stranger}), so that it does not matter who speaks first"
            if self._config.vehicle.system_id is not None:
                yield Finding(Severity.OK, "ids", f"system {stranger} is another autopilot; {ap.sysid} is flown")
                continue
            yield Finding(Severity.WARNING, "ids", f"system {stranger} is another autopilot; {ap.sysid} is flown", fix)
        rival = authority.rival_words(now_s)
        if rival:
            yield Finding(Severity.ERROR, "ids", rival)
        mode = f"{self.link.words.name(ap.custom_mode or 0)}, {'armed' if ap.armed else 'disarmed'}"
        why_not = "" if rival else authority.why_not(now_s)
        if why_not and authority.waits_for_take_off:  # as it should be, where this is asked
            auto = self._config.engage == "auto"
            text = "stands ready to take off" if auto else "on the ground: take off before you engage"
            yield Finding(Severity.OK, "mode", f"{mode}; {text}")
        elif why_not:
            yield Finding(Severity.WARNING, "mode", f"{mode}; {why_not}")
        else:
            yield Finding(Severity.OK, "mode", mode)
        sensors = ap.sensors
        # PX4 sets the health bit alone; ArduPilot calls the check present, too.
        tells = sensors is not None and (ap.kind == enums.MAV_AUTOPILOT_PX4 or sensors[0] & PREARM_CHECK)
        if tells and sensors is not None and not sensors[2] & PREARM_CHECK and not ap.armed:
            yield Finding(
                Severity.WARNING,
                "pre-arm",
                "the autopilot refuses to arm",
                "read its messages in the ground station: it says why",
            )

    def _streams(self, now_s: float) -> Iterator[Finding]:
        watched_s = now_s - self._since_s
        told: set[str] = set()
        for group in self._vehicle.needs:
            rates = {n: self._counts[by_name(n).msgid] / watched_s for n in group}
            name = max(rates, key=lambda n: rates[n])
            if name in told:  # it serves two needs
                continue
            told.add(name)
            wanted_hz = self._vehicle.messages_hz.get(name, 1.0)
            slow = rates[name] < SLOW_SHARE * wanted_hz
            yield Finding(
                Severity.WARNING if slow else Severity.OK,
                "streams",
                f"{name} at {rates[name]:.1f} Hz, {wanted_hz:g} asked for",
                "raise the baud rate, and MAV_x_RATE of that port" if slow else "",
            )

    def _range(self, now_s: float) -> Iterator[Finding]:
        rate_hz = self._accepted / (now_s - self._since_s)
        counts, ranging = self.ranges.counts, self._config.ranging
        if rate_hz >= LEAST_RANGE_HZ:
            yield Finding(Severity.OK, "range", f"{rate_hz:.1f} Hz, {sum(counts.rejected.values())} rejected")
        elif counts.accepted:
            fix = f"the estimate is carried after {ranging.max_age_s:g} s without one: check the radio and its antennas"
            few = f"only {rate_hz:.1f} Hz"
            if sum(counts.rejected.values()) > self.ranges.echoes:
                few += f", {commonest(counts.rejected, self.ranges.echoes)}"
            elif self.ranges.endpoint is not None and (why := self.ranges.why_none(self.ranges.endpoint, now_s)):
                few += f"; {why}"
            yield Finding(Severity.WARNING, "range", few, fix)
        elif self._decoys and self._decoys == sum(counts.rejected.values()):
            yield Finding(
                Severity.ERROR,
                "range",
                f"only the autopilot's own range finder or its echoes ({self._decoys}), never the beacon's",
                "start the ranging radio; its sender must not be component 1, nor its orientation 25 (down)",
            )
        elif self.ranges.endpoint is not None:
            yield Finding(Severity.ERROR, "range", self.ranges.why_none(self.ranges.endpoint, now_s))
        elif counts.rejected:
            reason = max(counts.rejected, key=lambda word: counts.rejected[word])
            text = f"none can be used: most are {reason} ({counts.last_detail.get(reason, '')})"
            yield Finding(Severity.ERROR, "range", text, "check the ranging section of the configuration")
        else:
            yield Finding(
                Severity.ERROR,
                "range",
                f"no {ranging.source} is heard",
                "start the ranging radio; check ranging.source",
            )

    def _settings(self) -> Iterator[Finding]:
        """What the autopilot's parameters say: if this app dies, if the RC is lost, and what it clips."""
        parameters = self.link.parameters
        known = facts(self._config, has_rc=self._has_rc, sysid=self.link.autopilot.sysid or 1, parameters=parameters)
        yield from judged(TABLES[self._vehicle.name], known)
        if not self.link.words.loss_parameter:
            text = (
                f"it holds the last bank for {self.link.words.loss_timeout_s:g} s, then flies straight on the heading "
                "of the engagement and stays in Guided: nothing brings it home by itself"
            )
            yield Finding(Severity.OK, "if this app dies", text)

    @property
    def _has_rc(self) -> bool:
        sensors = self.link.autopilot.sensors
        receiver = sensors is not None and bool(sensors[0] & sensors[1] & sensors[2] & RC_RECEIVER)
        return receiver or self._sticks

    def _pilot(self) -> Iterator[Finding]:
        """Whether somebody has sticks."""
        if self._has_rc:
            yield Finding(Severity.OK, "RC", "a receiver or joystick is heard")
        else:
            fix = "without sticks, only the ground station's mode switch takes the aircraft back"
            yield Finding(Severity.WARNING, "RC", "no receiver, no joystick", fix)

    def _battery(self) -> Iterator[Finding]:
        ap, least = self.link.autopilot, self._config.safety.battery_pct
        if isnan(ap.battery_pct) and not ap.battery_alarm:
            fix = "calibrate the power module; until then safety.battery_pct protects nothing"
            yield Finding(Severity.WARNING, "battery", "the autopilot does not measure it", fix)
        elif ap.battery_alarm or ap.battery_pct <= least:
            text = f"{ap.battery_pct:.0f} %, handed back at {least:g} %"
            yield Finding(Severity.ERROR, "battery", text, "charge it; safety.battery_pct is the limit")
        else:
            yield Finding(Severity.OK, "battery", f"{ap.battery_pct:.0f} %, {ap.battery_v:.1f} V")
