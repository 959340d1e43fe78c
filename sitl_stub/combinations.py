"""Options of the command line that would do nothing beside the others: told, never ignored."""

from __future__ import annotations

import argparse
from collections.abc import Iterator

from sitl_stub.devices import DEVICES, WITH_ID

# By their names in the parsed arguments.
OF_MESSAGES = ("ranging_port", "range_message", "range_from", "sensor_id", "orientation")
OF_THE_RADIO = (
    *("device", "device_port", *OF_MESSAGES, "beacon_id", "rate", "sigma", "bias", "range_step", "latency"),
    *("outliers", "outlier_mean", "dropout", "max_range"),
)
NO_BEACON_ID = {"distance_sensor", *DEVICES.keys() - WITH_ID}


def given(parser: argparse.ArgumentParser, argv: list[str] | None) -> set[str]:
    """Return the names of the options that somebody wrote, those left at their defaults not among them."""
    blank = argparse.Namespace(**dict.fromkeys(vars(parser.parse_args([]))))  # a name that is there gets no default
    return {name for name, value in vars(parser.parse_args(argv, blank)).items() if value is not None}


def idle(a: argparse.Namespace, wrote: set[str]) -> Iterator[str]:
    """Say of each option that was written (see `given`) and cannot act why that is, one line each."""
    if a.sign == "":
        yield "--sign needs a passphrase that is not empty"
    if "start_speed" in wrote and not a.airborne > 0.0:
        yield "--start-speed is the speed of an airborne start: add --airborne HEIGHT"
    if "airspeed_scale" in wrote and a.airframe != "fixed_wing":
        yield "--airspeed-scale is of the airspeed sensor of a fixed wing: add --airframe fixed_wing"
    if a.no_radio:
        yield from _beside("--no-radio", "leaves no radio on board", OF_THE_RADIO, wrote)
        return
    if a.device:
        yield from _beside(f"--device {a.device}", "sends bytes and no messages", OF_MESSAGES, wrote)
    else:
        if "device_port" in wrote:
            yield "--device-port is for a device's bytes: add --device NAME"
        if a.range_message != "distance_sensor":
            what = f"--range-message {a.range_message}"
            yield from _beside(what, "carries neither", ("sensor_id", "orientation"), wrote)
    if "beacon_id" in wrote and (a.device or a.range_message) in NO_BEACON_ID:
        yield f"--beacon-id does nothing: {a.device or a.range_message} carries none"
    if "outlier_mean" in wrote and not a.outliers:
        yield "--outlier-mean is the mean detour of outliers: add --outliers SHARE"


def _beside(what: str, why: str, names: tuple[str, ...], wrote: set[str]) -> Iterator[str]:
    if found := [f"--{name.replace('_', '-')}" for name in names if name in wrote]:
        yield f"{what} {why}: leave out {', '.join(found)}"
