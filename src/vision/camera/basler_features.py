"""Settings of a Basler camera, under the names used by its generation.

USB and ace 2 cameras follow the Standard Features Naming Convention (``ExposureTime`` in us, ``Gain`` in dB). Older
GigE cameras have ``ExposureTimeAbs`` or ``ExposureTimeRaw`` (in units of ``ExposureTimeBaseAbs``), and a ``GainRaw`` in
a unit specific to the model.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

Feature = bool | int | float | str
Refuse = Callable[[str, Any, str], Exception]
"""Returns the error for a setting that cannot be made, from its key, its value and the rule."""


def set_exposure(nodes: Any, exposure: float, refuse: Refuse) -> float:
    """Set the exposure of every frame, s.

    Args:
        nodes: the camera's node map.

    Returns:
        Exposure set by the camera, s.
    """
    choose(nodes, "ExposureAuto", "Off")
    choose(nodes, "ExposureMode", "Timed")
    wanted_us = 1e6 * exposure
    for name in ("ExposureTime", "ExposureTimeAbs"):
        node = nodes.GetNode(name)
        if node.IsWritable():
            return 1e-6 * _set(node, "exposure_us", wanted_us, "us", refuse)
    node, base = nodes.GetNode("ExposureTimeRaw"), nodes.GetNode("ExposureTimeBaseAbs")
    if not (node.IsWritable() and base.IsReadable()):
        raise refuse("exposure_us", wanted_us, "the exposure of this camera cannot be set")
    unit_us = float(base.GetValue())
    low, high = node.GetMin(), node.GetMax()
    units = low + round((wanted_us / unit_us - low) / node.GetInc()) * node.GetInc()
    if not low <= units <= high:
        raise refuse(
            "exposure_us",
            wanted_us,
            f"must be from {low * unit_us:g} to {high * unit_us:g} us on this camera",
        )
    node.SetValue(units)
    return 1e-6 * unit_us * float(node.GetValue())


def set_gain(nodes: Any, gain: float, refuse: Refuse) -> float:
    """Set the gain, dB.

    Returns:
        Gain set by the camera, dB.
    """
    choose(nodes, "GainAuto", "Off")
    for name in ("Gain", "GainAbs"):
        node = nodes.GetNode(name)
        if node.IsWritable():
            return _set(node, "gain_db", gain, "dB", refuse)
    node = nodes.GetNode("GainRaw")
    if not node.IsWritable():
        raise refuse("gain_db", gain, "the gain of this camera cannot be set")
    raise refuse(
        "gain_db",
        gain,
        "this camera has no gain in dB; leave it out and write features = { GainRaw = NUMBER }, "
        f"from {node.GetMin()} to {node.GetMax()} in the model's own unit",
    )


def set_heartbeat(stream_nodes: Any, heartbeat: float) -> None:
    """Set the time after which a GigE camera is free again if its program ends abruptly; others have no such setting.

    Args:
        stream_nodes: node map of the transport layer.
    """
    node = stream_nodes.GetNode("HeartbeatTimeout")
    if node is None or not node.IsWritable():
        return
    wanted_ms = round(1e3 * heartbeat)
    step = node.GetInc()
    inside = min(max(wanted_ms, node.GetMin()), node.GetMax())
    node.SetValue(node.GetMin() + (inside - node.GetMin()) // step * step)


def set_features(
    nodes: Any, features: Mapping[str, Feature], refuse: Refuse, errors: type[Exception]
) -> None:
    """Set any features by the camera's own names, in order; true executes a command.

    Args:
        errors: base class of the library's exceptions.
    """
    for name, value in features.items():
        node = nodes.GetNode(name)
        if not node.IsValid():
            raise refuse(f"features.{name}", value, "this camera has no such feature; use its own names")
        try:
            node.FromString(str(int(value)) if isinstance(value, bool) else str(value))
        except errors as error:
            raise refuse(f"features.{name}", value, message_of(error)) from error


def message_of(error: Exception) -> str:
    """Message of one of the library's errors, without the location in its source."""
    return str(error).rsplit(" : ", 1)[0].strip().rstrip(".")


def choose(nodes: Any, name: str, value: str) -> None:
    """Set a feature to a value if the camera has both."""
    node = nodes.GetNode(name)
    if node.IsWritable() and node.CanSetValue(value):
        node.SetValue(value)


def _set(node: Any, key: str, value: float, unit: str, refuse: Refuse) -> float:
    low, high = node.GetMin(), node.GetMax()
    if not low <= value <= high:
        raise refuse(key, value, f"must be from {low:g} to {high:g} {unit} on this camera")
    node.SetValue(value)
    return float(node.GetValue())
