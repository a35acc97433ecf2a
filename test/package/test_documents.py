"""What the README and docs/ name is there: commands, options, parameters, topics, files."""

import re
import shlex
from dataclasses import fields
from pathlib import Path

import pytest
import typer

from occ_recon_ros.cli.app import app
from occ_recon_ros.cli.arguments import parse_settings
from occ_recon_ros.cli.examples import EXAMPLES
from occ_recon_ros.geometry import Status
from occ_recon_ros.nodes.settings import NODE_SETTINGS, all_names
from occ_recon_ros.streams.topics import TOPICS

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
TEXTS = {path.name: path.read_text(encoding="utf-8") for path in DOCUMENTS}
SOURCE = "\n".join(
    path.read_text(encoding="utf-8")
    for folder in ("occ_recon_ros", "msg_adapters")
    for path in sorted((ROOT / folder).rglob("*.py"))
)
COMMAND = typer.main.get_command(app)


def parsed(line: str) -> dict:
    """What a command line says; raises where it cannot be."""
    words = shlex.split(line, comments=True)
    assert words.pop(0) == "occ-recon"
    command = COMMAND
    context = command.make_context("occ-recon", list(words))
    while hasattr(command, "resolve_command"):
        name, command, words = command.resolve_command(context, words)
        context = command.make_context(name, list(words), parent=context)
    assignments = context.params.get("settings") or []
    parse_settings(assignments)
    return context.params


def command_lines(text: str) -> list[str]:
    """The calls of occ-recon in blocks of code, and those in the text that are whole."""
    text = re.sub(r"\\\n\s*", "", text)
    blocks = re.findall(r"^ {4,}(?:\S*/)?(occ-recon .*)$", text, re.MULTILINE)
    inline = re.findall(r"`(occ-recon \S[^`]*)`", text)
    lines = [part.strip() for line in blocks + inline for part in line.split("&&")]
    return [line for line in lines if "..." not in line]


@pytest.mark.parametrize("name", [name for name in TEXTS if command_lines(TEXTS[name])])
def test_commands_of_the_documents_are_understood(name):
    for line in command_lines(TEXTS[name]):
        if len(shlex.split(line, comments=True)) > 3 or "-" in line.removeprefix("occ-recon"):
            parsed(line)  # the whole of it
        else:  # named in passing
            known(line.split()[1:])


def known(words: list[str]) -> None:
    """Whether there is such a command."""
    command, context = COMMAND, COMMAND.make_context("occ-recon", list(words))
    while words and hasattr(command, "resolve_command"):
        _, command, words = command.resolve_command(context, words)


def test_readme_teaches_the_ways_in():
    shown = {line.split()[1] for line in command_lines(TEXTS["README.md"])}
    assert {"demo", "board", "scan", "run", "import", "replay", "segment", "refine"} <= shown


@pytest.mark.parametrize("command", EXAMPLES)
def test_examples_of_the_help_are_understood(command):
    for line in EXAMPLES[command]:
        assert line.startswith(f"occ-recon {command}")
        parsed(line)


def commands(group, before: str = "") -> set[str]:
    found = set()
    for name, command in group.commands.items():
        inner = hasattr(command, "commands")
        found |= commands(command, f"{before}{name} ") if inner else {f"{before}{name}"}
    return found


def test_every_command_has_an_example_and_a_short_help():
    assert commands(COMMAND) == EXAMPLES.keys()


@pytest.mark.parametrize("name", TEXTS)
def test_settings_of_the_documents_are_parameters(name):
    for assignment in re.findall(r"--set ([\w.]+=[^`\s]+)", TEXTS[name]):
        if assignment != "NODE.PARAM=VALUE":
            parse_settings([assignment])


def test_troubles_name_parameters_that_exist_with_the_defaults_they_have():
    text = TEXTS["TROUBLESHOOTING.md"]
    with_default = re.findall(r"`(\w+)` \((-?[\d.]+)[ ,)]", text)
    assert len(with_default) > 4
    defaults = {f.name: f.default for kind in NODE_SETTINGS.values() for f in fields(kind)}
    for parameter, value in with_default:
        assert float(value) == pytest.approx(defaults[parameter], rel=1e-6), parameter
    for parameter, value in re.findall(r"`(\w+): ([\w.]+)`", text):
        if parameter == "data":  # which is a field of a service
            continue
        node = next(n for n, kind in NODE_SETTINGS.items() if parameter in names_of(kind))
        parse_settings([f"{node}.{parameter}={value}"])


def names_of(kind: type) -> set[str]:
    return {item.name for item in fields(kind)}


@pytest.mark.parametrize("name", ["README.md", "LIVE.md", "TROUBLESHOOTING.md"])
def test_every_name_in_code_is_one_of_ours(name):
    ours = all_names() | NODE_SETTINGS.keys() | {s.name.lower() for s in Status}
    ours |= {part for row in TOPICS for part in row.name.split("/")}
    for word in set(re.findall(r"`~?/?([a-z]+(?:_[a-z]+)+)`", TEXTS[name])) - ours:
        # Reasons of drops, columns of files and the like: words of the source.
        word = word.removeprefix("lost_")
        assert re.search(rf"[\"'`{{ ~/]{word}[\"'`}} ,:(]", SOURCE), word


def test_words_of_the_nodes_are_quoted_as_they_are():
    """What stands in code in TROUBLESHOOTING.md as a message can be searched for."""
    quoted = [q for q in re.findall(r"`([a-z][^`]*)`", TEXTS["TROUBLESHOOTING.md"]) if " " in q]
    source = re.sub(r"\"\n\s*f?\"", "", SOURCE)
    for quote in quoted:
        if quote.startswith(("occ-recon", "calibrate", "replay ")) or ": " in quote:
            continue
        for piece in re.split(r"\.\.\.|/\w+|\w+_\w+|\(.*\)|'\w+'|\d+(?:\.\d+)?", quote):
            if len(piece.split()) > 1:
                assert piece.strip() in source, f"{quote}: {piece}"


@pytest.mark.parametrize("name", TEXTS)
def test_links_lead_somewhere(name):
    path = next(p for p in DOCUMENTS if p.name == name)
    for target in re.findall(r"\]\(((?!http)[^)\s]+)\)", TEXTS[name]):
        file, _, anchor = target.partition("#")
        to = (path.parent / file).resolve() if file else path
        assert to.exists(), target
        if anchor:
            heads = re.findall(r"^#+ (.*)$", to.read_text(encoding="utf-8"), re.MULTILINE)
            slugs = {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}
            assert anchor in slugs, target


@pytest.mark.parametrize("name", ["README.md", "LIBRARY.md"])
def test_source_files_that_are_named_are_there(name):
    for file in re.findall(r"`((?:[a-z_]+/)+[a-z_]+\.(?:py|yaml|xml))`", TEXTS[name]):
        assert any((root / file).exists() for root in (ROOT, ROOT / "occ_recon_ros")), file
