"""ROS parameters from a frozen settings dataclass: declared, checked, kept up to date."""

import difflib
import math
from collections.abc import Iterable, Mapping
from dataclasses import Field, fields, replace
from typing import Any, Generic, TypeVar, get_type_hints

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from occ_recon_ros.errors import SettingsError

Settings = TypeVar("Settings")

_TYPES = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}
_ROS_OWN = ("use_sim_time", "start_type_description_service")


class Parameters(Generic[Settings]):
    """The settings of a node, mirrored in its ROS parameters.

    Args:
        node: that gets the parameters.
        settings_type: the dataclass.

    Attributes:
        values: the settings now in force.

    Raises:
        SettingsError: an initial value (YAML or -p) of a wrong type or out of range.
    """

    def __init__(self, node: Node, settings_type: type[Settings]) -> None:
        self.values: Settings = settings_type()
        self._types = get_type_hints(settings_type)
        # rclpy has no public way to see what was asked for before it is declared.
        given = {name: p.value for name, p in node._parameter_overrides.items()}
        names = {item.name for item in fields(settings_type)}  # type: ignore[arg-type]
        self.values = self._with({k: v for k, v in given.items() if k in names})
        for item in fields(settings_type):  # type: ignore[arg-type]
            value = getattr(self.values, item.name)
            # Set as override too: a whole number for a real one has become one.
            if item.name in given:
                node._parameter_overrides[item.name] = Parameter(item.name, value=value)
            node.declare_parameter(item.name, value, describe(item, type(value)))
        node.add_on_set_parameters_callback(self._refuse)
        node.add_post_set_parameters_callback(self._take_over)

    def _with(self, given: Mapping[str, Any]) -> Settings:
        """The settings with some values changed; SettingsError with the reason."""
        by_name = {item.name: item for item in fields(self.values)}  # type: ignore[arg-type]
        changes = {
            name: check(by_name[name], self._types[name], value) for name, value in given.items()
        }
        try:
            return replace(self.values, **changes)  # type: ignore[type-var]
        except ValueError as error:  # a settings class may check values against each other
            raise SettingsError(str(error)) from error

    def _ours(self, parameters: Iterable[Parameter]) -> dict[str, Any]:
        return {p.name: p.value for p in parameters if hasattr(self.values, p.name)}

    def _refuse(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            self._with(self._ours(parameters))
        except SettingsError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take_over(self, parameters: list[Parameter]) -> None:
        self.values = self._with(self._ours(parameters))


def check(item: Field, kind: Any, value: Any) -> Any:
    """The value, of the field's type, if it may be used.

    Raises:
        SettingsError: another type, not finite, out of range or not one of the choices.
    """
    if kind is float and type(value) is int:
        value = float(value)
    if type(value) is not kind:
        raise SettingsError(f"{item.name}: must be {_TYPES[kind]}, got {value!r}")
    if kind is float and not math.isfinite(value):
        raise SettingsError(f"{item.name}: must be finite, got {value}")
    low, high = item.metadata.get("within", (-math.inf, math.inf))
    if kind in (int, float) and not low <= value <= high:
        raise SettingsError(f"{item.name}: must be {range_text(item)}, got {value}")
    choices = item.metadata.get("choices")
    if choices and value not in choices:
        raise SettingsError(f"{item.name}: must be one of {', '.join(choices)}; got {value!r}")
    return value


def range_text(item: Field) -> str:
    """The range of a number in words, empty if it has none."""
    return " to ".join(map(str, item.metadata.get("within", ())))


def describe(item: Field, kind: type) -> ParameterDescriptor:
    """What `ros2 param describe` shows of a field."""
    meta = item.metadata
    choices = meta.get("choices", ())
    descriptor = ParameterDescriptor(
        name=item.name,
        description=str(meta.get("doc", "")),
        additional_constraints=f"one of {', '.join(choices)}" if choices else "",
        read_only=bool(meta.get("read_only", False)),
    )
    if "within" in meta:
        ends = dict(zip(("from_value", "to_value"), map(kind, meta["within"]), strict=True))
        if kind is float:
            descriptor.floating_point_range = [FloatingPointRange(**ends, step=0.0)]
        else:
            descriptor.integer_range = [IntegerRange(**ends, step=1)]
    return descriptor


def unknown_names(node: Node, known: Iterable[str]) -> list[str]:
    """A sentence for each initial parameter (YAML, -p) that no node knows.

    Args:
        node: the node, all of whose parameters are declared by now.
        known: the parameters of all nodes: a file for `/**` names those of the others too.
    """
    known = sorted({*known, *_ROS_OWN})
    sentences = []
    for name in node._parameter_overrides:
        if name in known or node.has_parameter(name):
            continue
        near = difflib.get_close_matches(name, known, 1)
        hint = f": did you mean '{near[0]}'?" if near else ""
        sentences.append(f"no node has a parameter '{name}'{hint}")
    return sentences
