"""The help of all commands as one page, and completion scripts for shells.

Both are generated from the dataclasses of the options, as the help is.
"""

from collections.abc import Mapping, Sequence
from typing import Literal

from readygo.apps.cli import CliCommand, function_of, options_of
from readygo.apps.options import CommandOptions, Option, OptionGroup, describe_options, section_groups

Shell = Literal["bash", "zsh", "fish"]


def describe_command(command: CliCommand) -> CommandOptions:
    """Description and options of a command; its module is imported."""
    return describe_options(options_of(function_of(command)))


def reference(commands: Mapping[str, CliCommand]) -> str:
    """The page of all commands, in Markdown: each with its options, and then once the groups that several share."""
    lines = ["# Commands", "", "Made of the code by `make golden`; the `--help-all` of each command says the same.", ""]
    about = {name: describe_command(command) for name, command in commands.items()}
    users: dict[type, list[str]] = {}
    for name, each in about.items():
        for group in each.groups:
            users.setdefault(group.kind, []).append(name)
    shared = {kind for kind, names in users.items() if len(names) > 1}
    sections: dict[str, OptionGroup] = {}
    for name, each in about.items():
        lines += [f"## readygo {name}", "", each.words, "", *_table(each.own.options)]
        for group in each.groups:
            if group.kind not in shared:
                lines += [f"{group.title}: {group.words}", "", *_table(group.options)]
        of_config = list(section_groups(each.sections, each.options)) if each.sections else []
        sections |= {group.heading: group for group in of_config}
        further = [_link(group.heading) for group in each.groups if group.kind in shared]
        further += [_link(group.heading) for group in of_config]
        if further:
            lines += [f"Further options: {', '.join(further)}.", ""]
    groups = {group.heading: group for each in about.values() for group in each.groups if group.kind in shared}
    for heading, group in (groups | sections).items():
        lines += [f"## {heading}", "", group.words, "", *_table(group.options)]
    return "\n".join(lines)


def completion(commands: Mapping[str, CliCommand], shell: Shell) -> str:
    """A script that completes commands, their options and the keys of their configuration.

    Args:
        commands: All commands.
        shell: Shell that the script is for.
    """
    options = {name: _flags(describe_command(command)) for name, command in commands.items()}
    if shell == "fish":
        return "".join(f"complete -c readygo {line}\n" for line in _fish(commands, options))
    cases = "\n".join(f'    "{name}") words="{" ".join(flags)}" ;;' for name, flags in options.items())
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


def _fish(commands: Mapping[str, CliCommand], options: Mapping[str, list[str]]) -> list[str]:
    lines = [f"-n __fish_use_subcommand -f -a {word}" for word in _first_words(commands)]
    for name, flags in options.items():
        group, _, second = name.partition(" ")
        seen = (
            f"-n '__fish_seen_subcommand_from {group}{f'; and __fish_seen_subcommand_from {second}' if second else ''}'"
        )
        lines += [f"-n '__fish_seen_subcommand_from {group}' -f -a {second}"] if second else []
        lines += [f"{seen} -l {flag.removeprefix('--')}" for flag in flags]
    return lines


def _flags(about: CommandOptions) -> list[str]:
    """All options of a command, with its keys and those of the help."""
    groups = section_groups(about.sections, about.options) if about.sections else ()
    keys = [option for group in groups for option in group.options if not option.flag.endswith(".NAME")]
    flags = [option.flag for option in (*about.options, *keys) if option.flag.startswith("--")]
    return [*flags, "--help", "--help-all"]


def _first_words(commands: Mapping[str, CliCommand]) -> list[str]:
    return list(dict.fromkeys(name.split()[0] for name in commands))


def _table(options: Sequence[Option]) -> list[str]:
    if not options:
        return []
    return ["| argument | | default |", "|---|---|---|", *map(_row, options), ""]


def _row(option: Option) -> str:
    typed = f"{option.flag} {option.value}".strip().replace("|", "\\|")
    return f"| `{typed}` | {option.words} | {option.default} |".replace("  ", " ")


def _link(heading: str) -> str:
    return f"[{heading}](#{heading.lower().replace(' ', '-').replace('_', '-')})"
