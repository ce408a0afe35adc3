"""The help of all commands as one page, and completion scripts for shells.

Both are generated from signatures and docstrings, as the help is.
"""

import inspect
import re
import typing
from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

from readygo.apps.cli import Command, function_of, option_name, value_name

Shell = Literal["bash", "zsh", "fish"]


class Parameter(NamedTuple):
    """One argument of a command."""

    flag: str
    """The option as typed, such as --out, or the name of a positional argument."""
    value: str
    """Name of its value in the help; empty for a switch."""
    default: str
    """Default value; empty if the argument is required, or if its description names the default."""
    words: str


class Described(NamedTuple):
    """A command with its arguments."""

    words: str
    """Text of its docstring before the arguments."""
    parameters: tuple[Parameter, ...]


def described(command: Command) -> Described:
    """Description and arguments of a command; its module is imported."""
    function = function_of(command)
    hints = typing.get_type_hints(function, include_extras=True)
    words, arguments = _docstring(inspect.getdoc(function) or "")
    parameters = inspect.signature(function).parameters.values()
    return Described(words, tuple(_parameter(each, hints[each.name], arguments) for each in parameters))


def reference(commands: Mapping[str, Command]) -> str:
    """The page of all commands, in Markdown."""
    lines = ["# Commands", "", "Made of the code by `make golden`; the `--help` of each command says the same.", ""]
    for name, command in commands.items():
        about = described(command)
        lines += [f"## readygo {name}", "", about.words, ""]
        if about.parameters:
            lines += ["| argument | | default |", "|---|---|---|"]
            lines += [_row(parameter) for parameter in about.parameters] + [""]
    return "\n".join(lines)


def completion(commands: Mapping[str, Command], shell: Shell) -> str:
    """A script that completes commands and their options.

    Args:
        commands: All commands.
        shell: Shell that the script is for.
    """
    options = {
        name: [p.flag for p in described(command).parameters if p.flag.startswith("--")]
        for name, command in commands.items()
    }
    if shell == "fish":
        return "".join(f"complete -c readygo {line}\n" for line in _fish(commands, options))
    cases = "\n".join(f'    "{name}") words="{" ".join(flags)} --help" ;;' for name, flags in options.items())
    script = _BASH.replace("CASES", cases).replace("COMMANDS", " ".join(_first_words(commands)))
    groups = {name.split()[0] for name in commands if " " in name}
    seconds = {
        group: [name.split()[1] for name in commands if name.startswith(f"{group} ")] for group in sorted(groups)
    }
    script = script.replace(
        "GROUPS", "\n".join(f'    "{group}") words="{" ".join(names)}" ;;' for group, names in seconds.items())
    )
    return f"autoload -U +X bashcompinit && bashcompinit\n{script}" if shell == "zsh" else script


_BASH = """\
_readygo() {
  local words="" current="${COMP_WORDS[COMP_CWORD]}"
  if [ "$COMP_CWORD" -eq 1 ]; then words="COMMANDS --help --version"; fi
  if [ "$COMP_CWORD" -eq 2 ]; then case "${COMP_WORDS[1]}" in
GROUPS
  esac; fi
  if [ -z "$words" ]; then case "${COMP_WORDS[1]} ${COMP_WORDS[2]}" in
CASES
  esac; fi
  if [ -z "$words" ]; then case "${COMP_WORDS[1]}" in
CASES
  esac; fi
  case "$current" in
    -*) COMPREPLY=($(compgen -W "$words" -- "$current")) ;;
    *) if [ "$COMP_CWORD" -gt 2 ] || [[ "$words" == --* ]]; then COMPREPLY=($(compgen -f -- "$current"))
       else COMPREPLY=($(compgen -W "$words" -- "$current")); fi ;;
  esac
}
complete -o filenames -F _readygo readygo
"""


def _fish(commands: Mapping[str, Command], options: Mapping[str, list[str]]) -> list[str]:
    lines = [f"-n __fish_use_subcommand -f -a {word}" for word in _first_words(commands)]
    for name, flags in options.items():
        group, _, second = name.partition(" ")
        seen = (
            f"-n '__fish_seen_subcommand_from {group}{f'; and __fish_seen_subcommand_from {second}' if second else ''}'"
        )
        lines += [f"-n '__fish_seen_subcommand_from {group}' -f -a {second}"] if second else []
        lines += [f"{seen} -l {flag.removeprefix('--')}" for flag in flags]
    return lines


def _first_words(commands: Mapping[str, Command]) -> list[str]:
    return list(dict.fromkeys(name.split()[0] for name in commands))


def _docstring(text: str) -> tuple[str, dict[str, str]]:
    """The text before the sections of a docstring, and the description of every argument by name."""
    words, _, rest = text.partition("\nArgs:\n")
    words = re.split(r"\n(?:Returns|Raises):\n", words)[0].strip()
    section = re.split(r"\n(?=\S)", rest)[0]
    found = re.findall(r"^ {4}(\w+): (.*(?:\n {5,}.*)*)", section, re.MULTILINE)
    return words, {name: " ".join(said.split()) for name, said in found}


def _parameter(parameter: inspect.Parameter, hint: Any, arguments: Mapping[str, str]) -> Parameter:
    positional = parameter.kind is inspect.Parameter.POSITIONAL_ONLY
    plain = parameter.name if positional else parameter.name.rstrip("_").rsplit("_", 1)[-1]
    value = "" if hint is bool else value_name(hint, plain, positional) or plain.upper()
    unsaid = parameter.default in (inspect.Parameter.empty, None, "", ()) or hint is bool
    name = value if positional else option_name(parameter.name)
    given = (
        ""
        if unsaid
        else " ".join(map(str, parameter.default))
        if isinstance(parameter.default, tuple)
        else str(parameter.default)
    )
    return Parameter(name, "" if positional else value, given, arguments.get(parameter.name, ""))


def _row(parameter: Parameter) -> str:
    typed = f"{parameter.flag} {parameter.value}".strip().replace("|", "\\|")
    return f"| `{typed}` | {parameter.words} | {parameter.default} |".replace("  ", " ")
