"""Parameters as given on the command line."""

import difflib
import re
import sys
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import Field, fields
from pathlib import Path
from typing import Any, get_type_hints

import yaml

from occ_recon_ros.errors import SettingsError, UserError
from occ_recon_ros.nodes.parameters import check
from occ_recon_ros.nodes.settings import NODE_SETTINGS

Values = dict[str, dict[str, Any]]
"""node -> parameter -> value"""

_NAMESPACE = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")
_MISSPELT = 0.85  # likeness from where on a name is taken for a wrong one of ours
_BOOLEANS = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}


def parse_settings(assignments: Iterable[str]) -> Values:
    """Values of ``--set NODE.PARAM=VALUE``, of the parameters' types and in their ranges.

    Raises:
        UserError: not of that form, no such node or parameter, or a value it cannot take.
    """
    values: Values = {}
    for assignment in assignments:
        target, equals, text = assignment.partition("=")
        node, dot, name = target.partition(".")
        if not (equals and dot and node and name):
            raise UserError(f"--set {assignment}: write it as NODE.PARAM=VALUE")
        _known(node, NODE_SETTINGS, f"--set {assignment}: no node")
        items = {item.name: item for item in fields(NODE_SETTINGS[node])}
        _known(name, items, f"--set {assignment}: {node} has no parameter")
        kind = get_type_hints(NODE_SETTINGS[node])[name]
        try:
            value = check(items[name], kind, _converted(items[name], kind, text))
        except SettingsError as error:
            raise UserError(f"--set {assignment}: {error}") from None
        values.setdefault(node, {})[name] = value
    return values


def override(values: Values, node: str, **parameters: Any) -> None:
    """Set parameters that the command itself depends on."""
    values.setdefault(node, {}).update(parameters)


def ros_arguments(params: Path | None, log_level: str) -> list[str]:
    """The --ros-args of a parameter file and a log level.

    Raises:
        UserError: there is no such file, or it is not YAML.
    """
    arguments = ["--ros-args", "--log-level", log_level]
    if params is not None:
        _content_of(params)
        arguments += ["--params-file", str(params)]
    return arguments


def _content_of(params: Path) -> dict[str, Any]:
    """What is wrong with a file rcl would say in several lines of its own."""
    try:
        content = yaml.safe_load(params.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise UserError(f"parameter file {params} does not exist: see config/rig.yaml") from None
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise UserError(f"parameter file {params} cannot be read: {error}") from None
    nodes = content.values() if isinstance(content, dict) else [None]
    if not all(isinstance(node, dict) for node in nodes):
        raise UserError(f"parameter file {params} must hold NODE: ros__parameters: NAME: VALUE")
    for name in _node_names(content):
        _known_in_file(params, name)
    return content


def values_in_file(params: Path | None, node: str) -> dict[str, Any]:
    """What a parameter file says of a node, as it stands there: by its name, or for all nodes."""
    found: dict[str, Any] = {}
    for name, values in ({} if params is None else _content_of(params)).items():
        if name.rpartition("/")[2] in (node, "**", "*"):
            found |= values.get("ros__parameters") or {}
    return found


def _node_names(content: dict[str, Any]) -> Iterator[str]:
    """Of the keys of a parameter file, such as /**/mesher, or mesher in those of a namespace."""
    for key, value in content.items():
        if "ros__parameters" not in value and all(isinstance(v, dict) for v in value.values()):
            yield from _node_names(value)
        else:
            yield str(key).rpartition("/")[2]


def _known_in_file(params: Path, name: str) -> None:
    """A name that is nearly one of ours is refused; the file may hold those of other nodes."""
    if name in NODE_SETTINGS or "*" in name or not name:
        return
    near = difflib.get_close_matches(name, NODE_SETTINGS, 1, _MISSPELT)
    if near:
        raise UserError(f"parameter file {params}: no node '{name}': did you mean '{near[0]}'")
    print(
        f"warning: parameter file {params}: '{name}' is none of our nodes: what is said of it "
        "counts for nothing here",
        file=sys.stderr,
    )


def parse_namespace(namespace: str) -> str:
    """A namespace as an absolute name, / for none.

    Raises:
        UserError: it cannot be one.
    """
    name = f"/{namespace.strip('/')}"
    if name != "/" and not _NAMESPACE.fullmatch(name):
        raise UserError(
            f"--namespace {namespace}: each part of it must begin with a letter and hold letters, "
            "digits and _ alone"
        )
    return name


def parse_remaps(rules: Iterable[str], targets: Collection[str] = ()) -> dict[str, str]:
    """``FROM:=TO`` rules as {FROM: TO} of absolute topic names.

    Args:
        rules: as given.
        targets: what TO may be, anything if there are none.

    Raises:
        UserError: not of that form, a topic renamed twice, or to what is none of the targets.
    """
    remaps: dict[str, str] = {}
    for rule in rules:
        source, sign, target = rule.partition(":=")
        if not (sign and source and target):
            raise UserError(f"--remap {rule}: write it as FROM:=TO, a topic of the bag first")
        source, target = (f"/{name.strip('/')}" for name in (source, target))
        if source in remaps:
            raise UserError(f"--remap {rule}: {source} is renamed twice")
        if targets and target not in targets:
            raise UserError(f"--remap {source}:={target}: {target} is none of {', '.join(targets)}")
        remaps[source] = target
    return remaps


def _known(name: str, names: Iterable[str], complaint: str) -> None:
    known: Sequence[str] = sorted(names)
    if name not in known:
        near = difflib.get_close_matches(name, known, 1)
        hint = f"did you mean '{near[0]}'" if near else f"there are {', '.join(known)}"
        raise UserError(f"{complaint} '{name}': {hint}")


def _converted(item: Field, kind: type, text: str) -> Any:
    try:
        if kind is bool:
            return _BOOLEANS[text.lower()]
        return kind(text)
    except (KeyError, ValueError):
        return text  # for check() to refuse in its words
