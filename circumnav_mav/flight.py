"""One flight, SANS-IO: bytes and a clock in, bytes and a record out.

`runtime` drives it over sockets, the lockstep tests in memory.

    bytes -> link -> ranging -> computer.on_sample
    tick  -> authority -> computer.tick -> encoder -> bytes
"""

from __future__ import annotations

from collections.abc import Callable
from math import inf, isfinite, isnan, nan

from circumnav_mav.config import Config, guidance_settings
from circumnav_mav.config_defaults import told
from circumnav_mav.flight_record import TickRecord
from circumnav_mav.guidance.computer import Decision, GuidanceComputer, Status
from circumnav_mav.guidance.kernel import Motion
from circumnav_mav.guidance.phases import ENGAGED, Phase
from circumnav_mav.guidance.target import Target, latitude_longitude, locate
from circumnav_mav.lookout import Lookout
from circumnav_mav.mavlink.autopilot import VehicleState
from circumnav_mav.mavlink.codec import Frame, Packer
from circumnav_mav.mavlink.engage import AutoEngage, Step
from circumnav_mav.mavlink.link import COMPANION_COMPONENT, AutopilotLink
from circumnav_mav.mavlink.offboard import WITH_AUTHORITY, Control
from circumnav_mav.mavlink.signing import Signer
from circumnav_mav.mavlink.vehicles import VEHICLES
from circumnav_mav.mavlink.vehicles.believed import BelievedSpeed
from circumnav_mav.mavlink.vehicles.fitness import Fitness, Unfit
from circumnav_mav.notices import INFO, WARNING, Event, Notices
from circumnav_mav.range_feed import RangeFeed
from circumnav_mav.ranging.plug import Reason
from circumnav_mav.turned_away import TurnedAway
from circumnav_mav.types import RangeSample, Rejected

VEHICLE, RANGING = "vehicle", "ranging"
"""Names of the two links. Ranges come on the first unless ranging.endpoint opens the second."""

MOVING_M_S = 1.0
MAP_S = 1.0
"""A ground station takes the circle off its map three seconds after the last message."""
PLACE_FRESH_S = 1.0
OVERHEAD_S = 30.0
"""So long nothing more is said of ranges near overhead; they are counted."""
SILENT = frozenset({Phase.RELEASED, Phase.FINISHED})
"""Phases in which nothing leaves that is no answer and no news: the aircraft is somebody else's."""
TEXT_SEVERITY = {Phase.RELEASED: WARNING, Phase.RANGE_LOST: WARNING, Phase.BROKEN_OFF: WARNING}
"""MAV_SEVERITY of what a phase says; INFO for the others."""
NO_SETPOINT = "no setpoint before a fresh mode message"
UNFIT_TOLD_AFTER_S = 4.0
"""Streams take a moment to begin after they are asked for."""


class Flight:
    """Everything between the sockets. `end` asks for a polite end; `done` says that there is nothing left to do."""

    def __init__(self, config: Config, signer: Signer | None = None) -> None:
        self._config = config
        self.ranges = RangeFeed(config.ranging)
        vehicle = config.vehicle_class
        self._vehicle, self.words = vehicle, vehicle.words
        subscribed = () if self.ranges.own_link else self.ranges.messages
        wanted_hz = config.messages_hz(subscribed)
        self.link = AutopilotLink(subscribed, wanted_hz, vehicle.words, signer, system_id=config.vehicle.system_id)
        self.link.authority.needs_air = vehicle.airframe != "rover"
        self.ranges.follow_clocks(self.link.time)
        self._to_radio = Packer(config.vehicle.system_id or 1, COMPANION_COMPONENT)
        """Unsigned, as what comes from there."""
        self.spoke = False
        """Whether the last bytes came from whom their link is to speak to: the autopilot, or the sender of ranges."""
        self.computer = GuidanceComputer(guidance_settings(config))
        self.lookout = Lookout(config, self.link.autopilot, self.computer)
        options = config.encoder_options()
        self._encoder = vehicle.encoder(options)
        self._believed = BelievedSpeed(options.speed_m_s, options.pitch_rad) if vehicle.speed == "believed" else None
        self._fitness = Fitness(vehicle, VEHICLES.values())
        self.unfit: Unfit | None = None
        """Why the autopilot that is heard cannot be flown by this vehicle class."""
        self._auto: AutoEngage | None = None
        if config.engage == "auto" and vehicle.take_off is not None:
            self._auto = AutoEngage(self.link, vehicle.take_off, config.orbit.height_m or nan)
        self.notices = Notices(self.link, lambda frames: self._frames.extend(frames))
        for heading, words in told(config):
            self.notices.tell(0.0, f"{heading}: {words}", INFO)
        self.turned_away = TurnedAway()
        self.rejected = self.turned_away.total
        self.engaged_s = nan
        self.end_reason = ""
        self.target = Target()
        self.target_place: tuple[float, float] | None = None
        """Latitude and longitude of the target [deg], while the autopilot has a position."""
        self._map_next_s = nan
        self._newest_range_m = nan
        self._sent_rad_s = nan
        self._blind = ""
        """What no setpoint could be made without at the last tick."""
        self._invited = False
        self._latch_commands = 0
        self._phase = self.computer.phase
        self._unfit_since_s = nan
        self._unfit_told = ""
        self._ticked_s = nan
        self.was_stopped = False
        """Whether the process was stopped since the last tick began."""
        self._frames: list[bytes] = []
        self._overhead_next_s = nan
        self._stuck_told = False
        self._r_m = nan
        self._end_action = "hold"

    @property
    def events(self) -> list[Event]:
        """What a person should read, oldest first."""
        return self.notices.events

    # -- bytes in ---------------------------------------------------------------------------------------------------

    def receive(self, data: bytes, now_s: float, link: str = VEHICLE, *, whole: bool = True) -> list[Frame]:
        """Take in what arrived on a link at `now_s`; return its frames, for the recorder."""
        if link == RANGING and self.ranges.own_link:
            self.ranges.on_vehicle(self.link.autopilot.sysid, moving=self._moving(now_s))
            frames, results = self.ranges.on_bytes(data, now_s, whole=whole)
            self.spoke = any(isinstance(result, RangeSample) for result in results)
        else:
            frames, messages = self.link.receive(data, now_s, whole=whole)
            self.spoke = self.link.autopilot_spoke
            self.ranges.on_vehicle(self.link.autopilot.sysid, moving=self._moving(now_s))
            results = [] if self.ranges.own_link else self.ranges.on_messages(messages, now_s)
        for result in results:
            self._on_range(result, now_s)
        if (words := self.ranges.receiver.clock_words) and self.notices.once("clock"):
            self.notices.tell(now_s, words, WARNING)
        return frames

    def _on_range(self, result: RangeSample | Rejected, now_s: float) -> None:
        if self.was_away(now_s):
            result = Rejected(now_s, "waited", "it waited in the link while the loop was held up: its age is unknown")
        if isinstance(result, RangeSample):
            self._newest_range_m = result.range_m
            rejected = self.computer.on_sample(
                result, self._motion(now_s), self._height_m(now_s), self._climb_m_s(now_s)
            )
            self._stuck_told = False
            if rejected is None:
                self.turned_away.used(now_s, self.ranges.echoes)
                return
            result = rejected
            if rejected.reason == "overhead" and not now_s < self._overhead_next_s:
                self._overhead_next_s = now_s + OVERHEAD_S
                self.notices.say(now_s, f"near overhead, where a range tells nothing: {rejected.detail}", INFO)
        elif result.reason == Reason.STUCK and not self._stuck_told:
            self._stuck_told = True
            words = f"the range is stuck: {result.detail}, and not used until it changes (ranging.stuck_s)"
            self.notices.say(now_s, words, WARNING)
        self.turned_away.add(str(result.reason))

    def _moving(self, now_s: float) -> bool:
        """Whether a range that stands still must be a stuck one: only above a walking speed, or half of a slower one.

        The speed is the one that the class flies by: without a position an autopilot may show 0 m/s over the ground.
        """
        ap = self.link.autopilot
        if self.link.authority.needs_air and ap.in_air is False:  # whatever the wind says to an airspeed sensor
            return False
        speed = self._motion(now_s).V
        if isnan(speed):
            speed = ap.ground_speed_m_s(now_s)
        return self._phase in ENGAGED if isnan(speed) else speed > min(MOVING_M_S, self._config.orbit.speed_m_s / 2)

    # -- the tick ---------------------------------------------------------------------------------------------------

    def was_away(self, now_s: float) -> bool:
        """Return whether the loop was held up for longer than half the loss timeout, or the process was stopped.

        What arrived meanwhile waits in the links with no sign of its age, and the autopilot may fly on its own by now.
        """
        return self.was_stopped or now_s - self._ticked_s > self.link.authority.loss_timeout_s / 2

    def stopped(self) -> None:
        """The process was stopped and continues (SIGCONT): the next tick counts as one after a gap, however short."""
        self.was_stopped = True

    def resume(self, now_s: float, take_in: Callable[[], float]) -> float:
        """Begin a tick: after a gap, `take_in` all that waits in the links, and believe no mode message older than now.

        A gap is a loop that was held up, and an autopilot that was not heard: setpoints that leave meanwhile may not
        arrive, and one that does after its failsafe has begun would take the aircraft back. take_in returns the time
        when it is done. Return the time to tick at. To be called before every `tick`.
        """
        away = self.was_away(now_s)
        if not away and not self.link.fell_silent(now_s):
            return now_s
        now_s = take_in()
        self.was_stopped = False
        if away:
            self.notices.say(now_s, f"the loop was held up: {NO_SETPOINT}", WARNING)
            self._frames += self.link.after_gap(now_s)
        elif self.link.fell_silent(now_s):
            silent_s = self.link.authority.loss_timeout_s / 2
            self.notices.say(now_s, f"nothing came from the autopilot for {silent_s:g} s: {NO_SETPOINT}", WARNING)
            self._frames += self.link.after_silence(now_s)
        return now_s

    def tick(self, now_s: float, lateness_s: float = 0.0, missed_ticks: int = 0) -> tuple[list[bytes], TickRecord]:
        """Decide and return (frames to send now, the record of this tick)."""
        link, authority = self.link, self.link.authority
        if self._believed is not None:
            self._believed.advance(now_s, link.autopilot.state(now_s), on_ground=link.autopilot.in_air is False)
        self._look_out(now_s)
        self._ticked_s = now_s
        self._follow_operator(now_s)
        self._judge(now_s)
        if self._auto is not None and link.autopilot.heard(now_s) and not self.end_reason:
            ready = self.computer.phase is Phase.READY
            self._auto.tick(now_s, ready=ready, may_ask=ready and not self._encoder.lacks)
        decision = self.computer.tick(now_s, self._status(now_s))
        self._r_m = decision.estimate.r if decision.estimate else nan
        self._on_phase(now_s, decision)
        self._sent_rad_s, self._blind = nan, ""
        if decision.setpoint is not None and authority.may_stream(now_s):
            encoded = self._encoder.encode(decision.setpoint, self._state(now_s), now_s)
            if encoded is None:
                self._blind = self._encoder.misses
            else:
                self._frames.append(link.setpoint(*encoded, now_s))
                self._sent_rad_s = decision.setpoint.turn_rate_rad_s
        self._invite(now_s)
        self._frames += link.poll(now_s) + link.read_parameters(now_s)
        self._show_target(now_s, decision)  # after the poll, which may find that the aircraft is no longer ours
        self.notices.watch_link(now_s)
        self._watch_noise(now_s)
        for words in self.computer.choice.news() if self.computer.choice is not None else ():
            self.notices.say(now_s, words, INFO)
        # In the order in which they were packed: a receiver of signed frames refuses one that is overtaken.
        frames, self._frames = self._frames, []
        return frames, self._record(now_s, decision, lateness_s, missed_ticks)

    def questions(self, now_s: float) -> list[bytes]:
        """Return what is to leave now on the radio's own link: TIMESYNC, and never anything else."""
        self._to_radio.sysid = self.link.autopilot.sysid or self._to_radio.sysid
        return self.ranges.questions(now_s, self._to_radio)

    def link_lost(self, link: str, now_s: float, words: str) -> None:
        """A link broke. On the vehicle's, nothing is sent or believed until a mode message newer than the break."""
        self.notices.tell(now_s, f"{link} link lost: {words}", WARNING)
        if link != VEHICLE:
            return
        authority = self.link.authority
        authority.gap(now_s)
        if authority.control is Control.ASKED:  # a request must not go on over a new connection, by itself
            authority.lost(f"the link was lost while {self.words.ours_name} was asked for")

    def link_back(self, link: str, now_s: float, words: str) -> None:
        """A link is open again. On the vehicle's the next tick asks for the mode, and sends no setpoint before it."""
        self.notices.tell(now_s, f"{link} link: {words}", INFO)
        if link != VEHICLE:
            self.ranges.time.forget()
            return
        self._frames.clear()  # what was to be said over the link that broke
        self._frames += self.link.reconnected(now_s)

    def tell(self, now_s: float, text: str) -> None:
        """Let the operator read something that only the runtime knows."""
        self.notices.tell(now_s, text, WARNING)

    def _look_out(self, now_s: float) -> None:
        """Walk the table of causes that end a flight."""
        news, belief = self.lookout.look(now_s, self._r_m, self._blind)
        if belief:
            self.notices.say(now_s, belief, INFO)
        for trip in news:
            self.notices.say(now_s, f"{trip.text}: {trip.action.replace('_', ' ')}", WARNING)
        if (trip_now := self.lookout.trip) is not None and trip_now.ends:
            self.end(trip_now.text, trip_now.action)

    def end(self, reason: str, action: str = "") -> None:
        """Ask for a polite end: hand over to that action (hold, return, land), then silence.

        Without one: Hold, or silence alone where the vehicle class cannot have it.
        """
        if not self.end_reason:
            self.end_reason, self._end_action = reason, action or ("hold" if self._vehicle.hands_over else "stop")

    @property
    def done(self) -> bool:
        """Whether the flight has ended."""
        return self.computer.phase is Phase.FINISHED

    @property
    def problem(self) -> str:
        """Why this flight cannot be: the wrong autopilot, or what engaging failed on; empty while all is well."""
        if self.unfit is not None and self.unfit.final:
            return self.unfit.text
        return self._auto.problem if self._auto else ""

    @property
    def left_behind(self) -> str:
        """What the vehicle goes on doing by itself when the app ends now; empty for nothing."""
        if self._auto is not None and self._auto.step in (Step.TAKING_OFF, Step.CLIMBING):
            return "the vehicle goes on with its take-off by itself"
        return ""

    @property
    def waiting_for(self) -> str:
        """What a person at the terminal should know while nothing flies yet."""
        phase = self.computer.phase
        if self.unfit is not None:
            return self.unfit.text
        if phase is Phase.READY and self._auto is not None and self._auto.step is not Step.LEFT_TO_PILOT:
            return self.link.authority.rival_words(self._ticked_s) or self._auto.step.value
        return self._encoder.lacks if phase is Phase.READY else ""

    def why_no_range(self, now_s: float) -> str:
        """Return why no range is used, as far as can be told, and what to do."""
        endpoint = self.ranges.endpoint
        own = self.ranges.why_none(endpoint, now_s) if endpoint is not None else ""
        return own or self.turned_away.why_none(now_s, self.ranges.echoes, self._config.ranging.max_age_s)

    def _status(self, now_s: float) -> Status:
        authority = self.link.authority
        control = authority.control
        return Status(
            heard=self.link.autopilot.heard(now_s) and self.unfit is None,
            held=control in (Control.HELD, Control.GIVING_BACK),
            released=control is Control.RELEASED,
            ending=bool(self.end_reason) and control is not Control.ASKED,
            why=authority.reason if control is Control.RELEASED else self._why(),
            motion=self._motion(now_s),
            height_m=self._height_m(now_s),
            broken=self.lookout.trip is not None and not self.lookout.trip.ends,
            handing_over=control is Control.GIVING_BACK,
        )

    def _why(self) -> str:
        if self.end_reason:
            return self.end_reason
        held = self.link.authority.control in (Control.HELD, Control.GIVING_BACK)
        return self.lookout.trip.text if self.lookout.trip and held else self.link.authority.reason

    def _judge(self, now_s: float) -> None:
        """Look whether the autopilot is the one for this vehicle class; say when a pilot may engage."""
        ap, before = self.link.autopilot, self.unfit
        self.unfit = self._fitness.unfit(ap, now_s, held=self.link.authority.control in WITH_AUTHORITY)
        if self.unfit is not None:
            if self.link.authority.control is not Control.RELEASED:
                self.link.ask_for(self._fitness.ask_again(ap, now_s))
            if before is None or self.unfit.text != before.text:
                self._unfit_since_s = now_s
            if now_s - self._unfit_since_s > UNFIT_TOLD_AFTER_S and self.unfit.text != self._unfit_told:
                self._unfit_told = self.unfit.text
                self.notices.say(now_s, self.unfit.text, WARNING)
        left_to_pilot = self._auto is None or self._auto.step is Step.LEFT_TO_PILOT
        if self.computer.phase is Phase.READY and left_to_pilot:
            self.link.authority.ready(now_s)

    def _invite(self, now_s: float) -> None:
        """Say once, while ready, that the pilot's choice of the mode is what it now takes."""
        streams = self._sent_rad_s == self._sent_rad_s
        by_itself = self._auto is not None and self._auto.step is not Step.LEFT_TO_PILOT
        if self._invited or by_itself or self.computer.phase is not Phase.READY:
            return
        if streams or not (self.words.stream_first or self.link.authority.grounded):
            self._invited = True
            self.notices.say(
                now_s, f"ready: {'streaming, ' if streams else ''}select {self.words.ours_name} to engage", INFO
            )

    def _follow_operator(self, now_s: float) -> None:
        authority = self.link.authority
        if self.end_reason and authority.control is Control.HELD:
            authority.give_back(self.words.hand_over(self._end_action), now_s, self.end_reason)
        if self.link.latch_commands != self._latch_commands:
            self._latch_commands = self.link.latch_commands
            opened = authority.open_latch()
            self._frames.append(self.link.answer_latch(opened))
            self.notices.say(
                now_s, "latch opened" if opened else "latch kept: no settled mode", INFO if opened else WARNING
            )

    def _on_phase(self, now_s: float, decision: Decision) -> None:
        phase = decision.phase
        self._hand_over(now_s, phase)
        if phase is self._phase:
            return
        before, self._phase = self._phase, phase
        if phase is Phase.FINISHED:
            self.link.commands.clear()
        if phase is Phase.ACQUIRING and not now_s >= self.engaged_s:
            self.engaged_s = now_s
        if phase in ENGAGED and before not in ENGAGED:
            for command in self._encoder.engaged(self.link.autopilot.state(now_s), self.computer.hold_height_m):
                self.link.commands.add(command)
        self._invited = False
        unfit = self.unfit if phase is Phase.WAITING_AUTOPILOT else None
        reason = decision.reason if unfit is None else unfit.text
        self.notices.say(now_s, f"{phase}: {reason}", TEXT_SEVERITY.get(phase, INFO))

    def _hand_over(self, now_s: float, phase: Phase) -> None:
        """Give back what is held without a range or against a cause to break off: every time, not only the first."""
        if self.link.authority.control is not Control.HELD or phase not in (Phase.RANGE_LOST, Phase.BROKEN_OFF):
            return
        action: str = self._config.on_range_lost
        why = "range lost"
        if phase is Phase.BROKEN_OFF:
            trip = self.lookout.trip
            action, why = (trip.action, trip.text) if trip is not None else (action, self.computer.reason)
        if phase is self._phase:
            self.notices.say(now_s, f"{phase}: engaged again: {why}: {action}", WARNING)
        self.link.authority.give_back(self.words.hand_over(action), now_s, f"{why}: {action}")

    def _watch_noise(self, now_s: float) -> None:
        times, expected_m = self.computer.estimator.times_noisier(), self._config.ranging.sigma_m
        if times > 1.0 and self.notices.once("noise"):
            words = f"ranges are noisier than ranging.sigma_m = {expected_m:g} m: about {times * expected_m:.1f} m"
            self.notices.tell(now_s, f"{words}, which is flown on", INFO)

    def _show_target(self, now_s: float, decision: Decision) -> None:
        """Locate the target; once a second show it to ground stations, with the orbit on the map while it is flown."""
        estimator, ap = self.computer.estimator, self.link.autopilot
        age_s = now_s - estimator.sample_time_s()
        self.target = locate(decision.estimate, estimator.covariance(), estimator.spread_m(), age_s)
        self.target_place = None
        if not self.target.known:
            return
        if now_s - ap.position_s <= PLACE_FRESH_S:
            self.target_place = latitude_longitude(ap.lat_deg, ap.lon_deg, self.target)
        silent = decision.phase in SILENT or self.link.authority.control is Control.RELEASED
        if now_s < self._map_next_s or silent:
            return
        self._map_next_s = now_s + MAP_S
        t = self.target
        self._frames.append(self.link.announce.target(now_s, t.north_m, t.east_m, t.sigma_m))
        if isfinite(t.drift_sigma_m_s):
            self._frames.append(self.link.announce.drift(now_s, t.drift_north_m_s, t.drift_east_m_s, t.drift_sigma_m_s))
        if decision.phase in ENGAGED and self.target_place is not None:
            orbit = self._config.orbit
            radius_m = orbit.radius_m if orbit.direction == "clockwise" else -orbit.radius_m
            self._frames.append(self.link.announce.orbit(now_s, radius_m, *self.target_place))

    def _motion(self, now_s: float) -> Motion:
        ap = self.link.autopilot
        turn_rate = ap.turn_rate_rad_s(now_s)
        if turn_rate != turn_rate:  # NaN: not measured, so what was asked
            turn_rate = self._sent_rad_s
        heading = ap.heading_rad(now_s)
        if self._believed is not None:
            return Motion(self._believed.speed_m_s, turn_rate, heading - self._believed.slip_rad)
        if self._vehicle.speed == "ground":
            return Motion(ap.ground_speed_m_s(now_s), turn_rate, heading, *ap.body_velocity_m_s(now_s))
        return Motion(ap.true_airspeed_m_s(now_s), turn_rate, heading)

    def _state(self, now_s: float) -> VehicleState:
        """What the encoder may know: with an airspeed that is believed where none is measured."""
        state = self.link.autopilot.state(now_s)
        return state if self._believed is None else state._replace(airspeed_m_s=self._believed.speed_m_s)

    def _height_m(self, now_s: float) -> float:
        return self.link.autopilot.height_above_home_m(now_s)

    def _climb_m_s(self, now_s: float) -> float:
        return self.link.autopilot.state(now_s).climb_m_s

    def _record(self, now_s: float, decision: Decision, lateness_s: float, missed_ticks: int) -> TickRecord:
        ap, estimate = self.link.autopilot, decision.estimate
        age_s = self.computer.sample_age_s(now_s)
        return TickRecord(
            now_s,
            decision.phase,
            self.link.authority.control,
            self.words.name(ap.custom_mode) if ap.custom_mode is not None else "",
            estimate.r if estimate else nan,
            estimate.r_dot if estimate else nan,
            self._newest_range_m,
            age_s if age_s < 1e6 else inf,
            decision.wanted_rad_s,
            self._sent_rad_s,
            ap.turn_rate_rad_s(now_s),
            ap.speed_m_s,
            decision.speed_source if self._believed is None else "believed",
            self._height_m(now_s),
            *self.target,
            *(self.target_place or (nan, nan)),
            int(decision.limits.saturated),
            int(decision.limits.slewed),
            int(decision.limits.barrier),
            int(decision.limits.way_out),
            self.rejected.total(),
            lateness_s,
            missed_ticks,
        )
