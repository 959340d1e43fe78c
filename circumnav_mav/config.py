"""The settings: typed, validated, each with the default of its vehicle class. Files of them: config_file.py."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import inf, isfinite, nan, radians
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    FiniteFloat,
    ModelWrapValidatorHandler,
    PrivateAttr,
    model_validator,
)

from circumnav_mav import endpoint
from circumnav_mav.config_checks import nearest
from circumnav_mav.config_defaults import USUAL_VEHICLE, with_defaults
from circumnav_mav.guidance.computer import GuidanceSettings
from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.kernel import LawContext
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.guidance.safety import Limits as SafetyLimits
from circumnav_mav.mavlink.autopilot import AUTOPILOT_COMPONENT
from circumnav_mav.mavlink.setpoints import SetpointLimits
from circumnav_mav.mavlink.streams import RANGES_HZ
from circumnav_mav.mavlink.vehicles import VEHICLES
from circumnav_mav.mavlink.vehicles.plug import Options, VehicleClass
from circumnav_mav.ranging import SOURCES


def _file_name(text: str) -> str:
    if "\0" in text:
        raise ValueError("no file has a character 0 in its name")
    return text


def _link(text: str) -> str:
    if endpoint.parse(text).kind == "file":
        raise ValueError("a file is no link to an autopilot: write " + endpoint.FORMS)
    return text


def _source(text: str) -> str:
    endpoint.parse(text)
    return text


def _one_of(what: str, known: dict[str, Any]) -> AfterValidator:
    def check(name: str) -> str:
        if name not in known:
            raise ValueError(f"no {what} '{name}'{nearest(name, known)}; there are: {', '.join(known)}")
        return name

    return AfterValidator(check)


def _no_boolean(value: Any) -> Any:
    if isinstance(value, bool):
        raise ValueError(f"must be a number, not {str(value).lower()}")
    return value


LEAST, MOST = 1e-6, 1e9
"""Sizes between which every number of a file lies that is not 0: nothing that flies needs others, and the arithmetic
of `check` and of the estimators ends far beyond."""


def _sane(value: float) -> float:
    if value != 0.0 and not LEAST <= abs(value) <= MOST:
        raise ValueError(f"must be 0, or between {LEAST:g} and {MOST:g} in size, not {value:g}")
    return value


def _height(value: Any) -> Any:
    if value is None or value == "auto":
        return value
    try:
        height_m = float(_no_boolean(value))
    except (TypeError, ValueError):
        height_m = nan
    if not isfinite(height_m):
        raise ValueError(f"must be a height in m, auto or null, not {value!r}")
    return _sane(height_m)


FileName = Annotated[str, AfterValidator(_file_name)]
Link = Annotated[FileName, AfterValidator(_link)]
RangingEndpoint = Annotated[FileName, AfterValidator(_source)]
Finite = Annotated[FiniteFloat, BeforeValidator(_no_boolean), AfterValidator(_sane)]
Whole = Annotated[int, BeforeValidator(_no_boolean)]
Positive = Annotated[Finite, Field(gt=0)]
NotNegative = Annotated[Finite, Field(ge=0)]
Height = Annotated[float | Literal["auto"], BeforeValidator(_height)]


class Section(BaseModel):
    """A part of the file: unknown keys are faults, values do not change after loading."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True, protected_namespaces=())


class Vehicle(Section):
    """The aircraft and the link to it."""

    kind: Annotated[str, _one_of("vehicle class", VEHICLES)] = Field(USUAL_VEHICLE, alias="class")
    link: Link = "udpin://0.0.0.0:14540"
    library: Literal["pymavlink", "mavsdk"] = "pymavlink"
    system_id: Whole | None = Field(None, ge=1, le=255)
    signing_key_file: FileName | None = None
    lead_s: NotNegative | None = Field(None, le=2.0)
    pitch_deg: Finite | None = Field(None, ge=-30.0, le=30.0)
    thrust: Finite | None = Field(None, gt=0.0, lt=1.0)


class Ranging(Section):
    """The range: where it comes from and which ones count. Further keys are options of the source."""

    model_config = ConfigDict(extra="allow", frozen=True, populate_by_name=True, protected_namespaces=())

    source: Annotated[str, _one_of("ranging source", SOURCES)] = "distance_sensor"
    endpoint: RangingEndpoint | None = None
    sender: tuple[Annotated[Whole, Field(ge=1, le=255)], Annotated[Whole, Field(ge=0, le=255)]] | None = Field(
        None, alias="from"
    )
    sensor_id: Whole | None = Field(None, ge=0, le=255)
    beacon_id: Whole | None = Field(None, ge=0)
    orientation: Whole | None = Field(None, ge=0, le=255)
    min_m: NotNegative | None = None
    max_m: Positive | None = None
    min_quality_pct: Finite | None = Field(None, ge=0, le=100)
    stuck_s: NotNegative | None = None
    use_stamps: bool = True
    stamped_by: Literal["sender", "autopilot"] = "sender"
    max_age_s: Positive = 1.0
    coast_s: NotNegative = 20.0
    bias_m: Finite = 0.0
    latency_s: NotNegative = 0.0
    sigma_m: Positive = 0.3
    target_height_m: Height | None = None

    @property
    def options(self) -> dict[str, Any]:
        """Return the keys that are the source's own."""
        return dict(self.__pydantic_extra__ or {})


class Orbit(Section):
    """The circle to fly."""

    radius_m: Annotated[Finite, Field(ge=0.1, le=100_000.0)] = 50.0
    direction: Literal["clockwise", "anticlockwise"] = "clockwise"
    speed_m_s: Annotated[Finite, Field(ge=0.01, le=1000.0)] = 5.0
    height_m: Positive | None = None
    r_min_m: Positive | None = None
    r_max_m: Positive | None = None


class Named(BaseModel):
    """A plug by name with its own options, numbers all."""

    model_config = ConfigDict(extra="allow", frozen=True)
    __pydantic_extra__: dict[str, Finite]
    name: str

    @property
    def options(self) -> dict[str, float]:
        """Return what the file gives beside the name."""
        return dict(self.__pydantic_extra__ or {})


def _named(value: Any) -> Any:
    if isinstance(value, str):
        raise ValueError(f"write {{name: {value}}}")
    return value


class LawChoice(Named):
    """The guidance law and its gains. Not named: that of the vehicle class."""

    name: Annotated[str, _one_of("law", LAWS)]


class EstimatorChoice(Named):
    """What turns ranges into what the law needs. Not named: that of the vehicle class."""

    name: Annotated[str, _one_of("estimator", ESTIMATORS)]


class Limits(Section):
    """What may be asked of the aircraft."""

    turn_rate_rad_s: Positive = 0.8
    turn_accel_rad_s2: Positive = 2.0
    bank_deg: Positive = Field(30.0, le=50.0)


Action = Literal["fly_on", "hold", "stop", "return", "land"]


class Safety(Section):
    """What ends a flight, and how: see guidance/safety.py."""

    flight_time_s: Positive | None = None
    laps: Positive | None = None
    on_used_up: Literal["hold", "stop", "return", "land"] = "hold"
    battery_pct: Annotated[Finite, Field(ge=0, le=100)] = 20.0
    on_battery_low: Action = "return"
    height_lost_s: Positive = 3.0
    on_height_lost: Action = "hold"
    on_estimates_lost: Action = "land"
    on_blind: Literal["hold", "stop", "return", "land"] = "hold"
    on_band_broken: Action = "hold"


class Loop(Section):
    """The fixed grid on which setpoints leave."""

    rate_hz: Annotated[Finite, Field(ge=5, le=400)] = 50.0


class Record(Section):
    """What a flight leaves on disk."""

    directory: FileName = "flights"
    tlog: bool = True


class Study(Section):
    """What `check` and `tune` reckon with; no flight reads it."""

    wind_m_s: NotNegative | None = None
    range_rate_hz: Positive = 10.0
    turn_lag_s: NotNegative | None = None


class Config(Section):
    """The whole file."""

    vehicle: Vehicle = Vehicle()  # type: ignore[call-arg]
    ranging: Ranging = Ranging()  # type: ignore[call-arg]
    orbit: Orbit = Orbit()
    law: Annotated[LawChoice, BeforeValidator(_named)] = Field(default=...)
    estimator: Annotated[EstimatorChoice, BeforeValidator(_named)] = Field(default=...)
    limits: Limits = Limits()  # type: ignore[call-arg]
    safety: Safety = Safety()
    loop: Loop = Loop()
    engage: Literal["pilot", "auto"] = "pilot"
    on_range_lost: Literal["hold", "stop", "return", "land"] = "hold"
    record: Record = Record()
    study: Study = Study()
    _defaulted: tuple[str, ...] = PrivateAttr(())

    @model_validator(mode="wrap")
    @classmethod
    def _fill_in(cls, data: Any, validate: ModelWrapValidatorHandler[Config]) -> Config:
        """Fill in what the vehicle class decides where the file does not."""
        if not isinstance(data, Mapping):
            return validate(data)
        filled, defaulted = with_defaults(data)
        config = validate(filled)
        config._defaulted = defaulted
        return config

    @property
    def defaulted(self) -> tuple[str, ...]:
        """Paths of the settings that the vehicle class decided: the file does not name them."""
        return self._defaulted

    def law_context(self) -> LawContext:
        """Return what a law's parameters are made from."""
        return LawContext(
            r_a=self.orbit.radius_m,
            V=self.orbit.speed_m_s,
            turn_rate_limit=self.turn_rate_limit_rad_s,
            turn_lag_s=self.vehicle_class.turn_lag_s,
            r_min=nan if self.orbit.r_min_m is None else self.orbit.r_min_m,
        )

    @property
    def vehicle_class(self) -> VehicleClass:
        """The class that vehicle.class names."""
        return VEHICLES[self.vehicle.kind]

    @property
    def turn_rate_limit_rad_s(self) -> float:
        """The turn rate that is never passed: limits.turn_rate_rad_s, or what the bank allows at the speed."""
        limits = self.limits
        bank_rad = radians(limits.bank_deg)
        return self.vehicle_class.turn_rate_limit(limits.turn_rate_rad_s, bank_rad, self.orbit.speed_m_s)

    @property
    def turn_lag_s(self) -> float:
        """How far the turn rate lags: study.turn_lag_s, or what was measured for the class."""
        return self.vehicle_class.turn_lag_s if self.study.turn_lag_s is None else self.study.turn_lag_s

    @property
    def lead_s(self) -> float:
        """How far the velocity runs ahead of the nose: vehicle.lead_s, or what was measured for the class."""
        return self.vehicle_class.lead_s if self.vehicle.lead_s is None else self.vehicle.lead_s

    def messages_hz(self, subscribed: Iterable[str]) -> dict[str, float]:
        """Return how often the autopilot is to send what, Hz: what the vehicle class needs, and the ranges (messages
        `subscribed`) where ranging.from names the autopilot itself.
        """
        wanted_hz = dict(self.vehicle_class.messages_hz)
        system, component = self.ranging.sender or (0, 0)
        if component == AUTOPILOT_COMPONENT and self.vehicle.system_id in (None, system):
            wanted_hz |= dict.fromkeys(subscribed, RANGES_HZ)
        return wanted_hz

    def encoder_options(self) -> Options:
        """Return what the vehicle class builds its encoder from."""
        v = self.vehicle
        return Options(
            limits=SetpointLimits(self.turn_rate_limit_rad_s, self.orbit.speed_m_s),
            speed_m_s=self.orbit.speed_m_s,
            bank_rad=radians(self.limits.bank_deg),
            lead_s=self.lead_s,
            pitch_rad=nan if v.pitch_deg is None else radians(v.pitch_deg),
            thrust=nan if v.thrust is None else v.thrust,
        )


RESTARTS_A_MINUTE = 5
"""So many restarts of the estimator within a minute mean that ranges and motion do not belong together."""


def safety_limits(config: Config) -> tuple[SafetyLimits, dict[str, str]]:
    """Return what may not be exceeded, and what is done about each cause of guidance/safety.py."""
    s, orbit = config.safety, config.orbit
    limits = SafetyLimits(
        r_min_m=orbit.r_min_m or -inf,
        r_max_m=orbit.r_max_m or inf,
        battery_pct=s.battery_pct,
        height_lost_s=s.height_lost_s,
        restarts_a_minute=RESTARTS_A_MINUTE,
        flight_time_s=s.flight_time_s or inf,
        laps=s.laps or inf,
    )
    return limits, {
        "diverged": config.on_range_lost,
        "band_broken": s.on_band_broken,
        "estimates_lost": s.on_estimates_lost,
        "blind": s.on_blind,
        "height_lost": s.on_height_lost,
        "battery_low": s.on_battery_low,
        "time_used_up": s.on_used_up,
        "laps_used_up": s.on_used_up,
    }


def guidance_settings(config: Config) -> GuidanceSettings:
    """Return the part of the configuration that the guidance computer is built from."""
    orbit, ranging = config.orbit, config.ranging
    target_m = ranging.target_height_m
    return GuidanceSettings(
        law=config.law.name,
        law_options=config.law.options,
        estimator=config.estimator.name,
        estimator_options=config.estimator.options,
        context=config.law_context(),
        clockwise=orbit.direction == "clockwise",
        turn_accel_limit_rad_s2=config.limits.turn_accel_rad_s2,
        max_age_s=ranging.max_age_s,
        coast_s=ranging.coast_s,
        sigma_m=ranging.sigma_m,
        height_m=nan if orbit.height_m is None else orbit.height_m,
        target_height_m=target_m if isinstance(target_m, float) else nan,
        choose_height=target_m == "auto",
        r_min_m=orbit.r_min_m or -inf,
        r_max_m=orbit.r_max_m or inf,
    )
