"""YAML -> typed, validated settings. Every fault is reported at once, with its line, before anything moves."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import inf, isfinite, nan, radians
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal, NamedTuple

import yaml
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    FiniteFloat,
    ModelWrapValidatorHandler,
    PrivateAttr,
    ValidationError,
    model_validator,
)

from circumnav_mav import endpoint
from circumnav_mav.config_checks import cross_checks, nearest
from circumnav_mav.config_defaults import USUAL_VEHICLE, with_defaults
from circumnav_mav.guidance.computer import GuidanceSettings
from circumnav_mav.guidance.estimators import ESTIMATORS
from circumnav_mav.guidance.kernel import LawContext
from circumnav_mav.guidance.laws import LAWS
from circumnav_mav.guidance.safety import Limits as SafetyLimits
from circumnav_mav.mavlink.setpoints import SetpointLimits
from circumnav_mav.mavlink.vehicles import VEHICLES
from circumnav_mav.mavlink.vehicles.plug import Options, VehicleClass
from circumnav_mav.ranging import SOURCES

Where = tuple[str | int, ...]


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


def _height(value: Any) -> Any:
    if value is None or value == "auto":
        return value
    try:
        height_m = float(_no_boolean(value))
    except (TypeError, ValueError):
        height_m = nan
    if not isfinite(height_m):
        raise ValueError(f"must be a height in m, auto or null, not {value!r}")
    return height_m


Link = Annotated[str, AfterValidator(_link)]
RangingEndpoint = Annotated[str, AfterValidator(_source)]
Finite = Annotated[FiniteFloat, BeforeValidator(_no_boolean)]
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
    signing_key_file: str | None = None
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

    radius_m: Positive = 50.0
    direction: Literal["clockwise", "anticlockwise"] = "clockwise"
    speed_m_s: Positive = 5.0
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

    directory: str = "flights"
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
    law: LawChoice = Field(default=...)
    estimator: EstimatorChoice = Field(default=...)
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


class Fault(NamedTuple):
    """One thing that is wrong: where (dotted path, line; 0 = the file as a whole) and what."""

    path: str
    line: int
    text: str


class ConfigError(Exception):
    """All faults of a file at once."""

    def __init__(self, file: str, faults: list[Fault]) -> None:
        self.file, self.faults = file, faults
        super().__init__("\n".join(self.lines()))

    def lines(self) -> Iterator[str]:
        """Yield one line a fault, `file:line: path: what`."""
        for fault in self.faults:
            place = f"{self.file}:{fault.line}" if fault.line else self.file
            yield f"{place}: {fault.path}: {fault.text}" if fault.path else f"{place}: {fault.text}"


def load(path: str | FilePath) -> Config:
    """Return the settings of a file. Raises ConfigError with every fault in it."""
    try:
        text = FilePath(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise ConfigError(str(path), [Fault("", 0, f"cannot read the configuration: {reason}")]) from error
    return parse(text, str(path))


def parse(text: str, file: str = "config") -> Config:
    """Return the settings in `text`. Raises ConfigError with every fault in it."""
    try:
        tree = yaml.compose(text, Loader=yaml.SafeLoader)
        lines = _Lines(tree)
        if lines.endless:
            raise ConfigError(
                file, [Fault(path, line, "an alias that contains itself") for path, line in lines.endless]
            )
        data = yaml.safe_load(text)
    except RecursionError as error:
        raise ConfigError(file, [Fault("", 0, "nested too deeply")]) from error
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        what = getattr(error, "problem", None) or str(error)
        raise ConfigError(file, [Fault("", mark.line + 1 if mark else 0, f"not YAML: {what}")]) from error
    if data is None:
        data = {}
    if not isinstance(data, dict):
        raise ConfigError(file, [Fault("", 1, "a configuration is a list of sections such as 'orbit: {radius_m: 50}'")])
    faults = [Fault(path, line, "given twice") for path, line in lines.twice]
    config = None
    try:
        config = Config.model_validate(data)
    except ValidationError as error:
        faults += [_fault(e, lines) for e in error.errors()]
    if config is not None:
        faults += [
            Fault(p, lines.of(tuple(p.split("."))), t) for p, t in cross_checks(config, guidance_settings(config))
        ]
    if faults or config is None:
        raise ConfigError(file, sorted(faults, key=lambda f: f.line))
    return config


def _fault(error: Any, lines: _Lines) -> Fault:
    where: Where = tuple(error["loc"])
    path = ".".join(str(p) for p in where)
    if error["type"] == "extra_forbidden":
        known = _keys_at(where[:-1])
        return Fault(path, lines.of(where), f"no such key{nearest(str(where[-1]), known) or '; ' + _listed(known)}")
    message = error["msg"].removeprefix("Value error, ")
    if error["type"] == "literal_error":
        message = f"must be {error['ctx']['expected']}{nearest(str(error['input']), _quoted(error))}"
    elif error["type"] != "value_error":
        message = f"{message[0].lower()}{message[1:]}, not {error['input']!r}"
    return Fault(path, lines.of(where), message)


def _quoted(error: Any) -> list[str]:
    return str(error["ctx"]["expected"]).replace("'", "").replace(" or ", ", ").split(", ")


def _listed(known: list[str]) -> str:
    return "there are: " + ", ".join(known)


def _keys_at(where: Where) -> list[str]:
    model: type[BaseModel] = Config
    for part in where:
        field = model.model_fields.get(str(part)) or next(
            (f for f in model.model_fields.values() if f.alias == part), None
        )
        inner = field.annotation if field else None
        if not (isinstance(inner, type) and issubclass(inner, BaseModel)):
            return []
        model = inner
    return [field.alias or name for name, field in model.model_fields.items()]


class _Lines:
    """Which line of the file each key stands on, which keys stand there twice, and which aliases contain themselves."""

    def __init__(self, tree: yaml.Node | None) -> None:
        self._at: dict[Where, int] = {}
        self._open: set[int] = set()  # ids of the nodes that the walk is inside of
        self._seen: set[int] = set()  # ids of all nodes: what an alias repeats is walked once
        self.twice: list[tuple[str, int]] = []
        self.endless: list[tuple[str, int]] = []
        if tree is not None:
            self._walk(tree, ())

    def _walk(self, node: yaml.Node, where: Where) -> None:
        if id(node) in self._open:
            self.endless.append((".".join(str(p) for p in where), self.of(where)))
        if id(node) in self._seen:
            return
        self._seen.add(id(node))
        self._open.add(id(node))
        if isinstance(node, yaml.MappingNode):
            for key, value in node.value:
                here = (*where, str(key.value))
                line = key.start_mark.line + 1
                if here in self._at:
                    self.twice.append((".".join(str(p) for p in here), line))
                self._at[here] = line
                self._walk(value, here)
        elif isinstance(node, yaml.SequenceNode):
            for n, item in enumerate(node.value):
                self._walk(item, (*where, n))
        self._open.discard(id(node))

    def of(self, where: Where) -> int:
        """Return the line of a path, or of the nearest part of it that stands in the file; 0 for none."""
        texts = tuple(str(p) for p in where)
        while texts:
            if texts in self._at:
                return self._at[texts]
            texts = texts[:-1]
        return 0
