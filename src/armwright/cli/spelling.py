"""Words of a command line before typer reads them: old names become new ones."""

from __future__ import annotations

import re
from collections.abc import Iterable
from math import isfinite
from typing import Any

from typer import BadParameter
from typer.core import TyperCommand

from armwright.cli.old_names import OLD, UNTIL, Names
from armwright.terminal import gathered, is_quiet, note

FILES = ("--output", "--plot", "--report")  # that a command is asked to write
UsageError: Any = BadParameter.__mro__[1]  # typer keeps it to itself
GLOBAL = ("--quiet", "--traceback")  # options of the whole program
NO_NUMBER = re.compile(r"Input should be (a valid number|a valid integer)")


class Spelled(TyperCommand):
    """Command that understands the old names of its options and arguments, see `old_names`, and says the new ones."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Reads the words with old names replaced, each in a note on standard error."""
        old = OLD.get(path_of(ctx), {})
        if old and not ctx.resilient_parsing:
            args = self._renamed(ctx, list(args), old)
        try:
            return super().parse_args(ctx, list(args))
        except BadParameter as error:
            raise self._with_value(ctx, args, error) from None

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Words of the line of usage: arguments by their names, in brackets where they may be left out."""
        names = [(each.metavar, each.required) for each in self.params if each.param_type_name == "argument"]
        return ["[OPTIONS]", *(str(name) if required else f"[{name}]" for name, required in names)]

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Writes the help."""
        without_types(self.get_params(ctx))
        super().format_help(ctx, formatter)

    def invoke(self, ctx: Any) -> Any:
        """Runs the command; where it writes a file and shall be quiet, nothing else is shown."""
        files = [each.name for each in self.params if set(FILES) & set(each.opts)]
        if is_quiet() and not ctx.params.get("as_json") and any(ctx.params.get(name) is not None for name in files):
            with gathered():
                return super().invoke(ctx)
        return super().invoke(ctx)

    def _with_value(self, ctx: Any, args: list[str], error: Any) -> Exception:
        """The error of a word that is no number, which typer reports without the word; others as they are."""
        found = NO_NUMBER.match(error.message)
        if found is None or error.param is None:
            return error
        value = self.make_parser(ctx).parse_args(list(args))[0].get(error.param.name)
        return UsageError(f"{max(error.param.opts, key=len)} = {value!r}: expected {found[1]}", ctx=ctx)

    def _renamed(self, ctx: Any, args: list[str], old: Names) -> list[str]:
        """The words in new names; those behind `--` are arguments and stay."""
        end = args.index("--") if "--" in args else len(args)
        first, kept, words = [], [], iter(args[:end])
        for word in words:
            name, equals, value = word.partition("=")
            if name not in old or not name.startswith("-"):
                kept.append(word)
                continue
            entry = old[name]
            new, change = entry if isinstance(entry, tuple) else (entry, None)
            taken = None if equals else next(words, None) if change or new == "ROBOT" else None
            text = value if equals else taken
            if (change or new == "ROBOT") and text is None:  # no value: typer says so, of the new name
                kept.append(name if new == "ROBOT" else new)
            elif new == "ROBOT":
                _say(name, f"{new}, the first argument")
                first.append(text)
            elif change:
                kept += [new, changed(name, new, change, text or "")]
            else:
                _say(name, new)
                kept.append(f"{new}={value}" if equals else new)
        return [*first, *self._last_as_option(ctx, kept, old), *args[end:]]

    def _last_as_option(self, ctx: Any, args: list[str], old: Names) -> list[str]:
        """The words with a last argument that became an option as that option."""
        new = next((new for name, new in old.items() if not name.startswith("-")), None)
        if not isinstance(new, str):
            return args
        parser = self.make_parser(ctx)
        declared, parser._args = len(parser._args), []
        found = parser.parse_args(list(args))[1]
        if len(found) != declared + 1:
            return args
        place = len(args) - 1 - args[::-1].index(found[-1])
        _say("the last argument", new)
        return [*args[:place], *args[place + 1 :], new, found[-1]]


def without_types(parameters: Iterable[Any]) -> None:
    """Leaves out the types of flags and arguments in the help: `<bool>`, `<path>`. Values of options have names that say more."""
    for each in parameters:
        if each.param_type_name == "argument" or each.is_flag:
            each.display_type_rich = lambda **_: None


def global_first(args: list[str]) -> list[str]:
    """The words of a command line with options of the whole program first, wherever they stood before `--`."""
    end = args.index("--") if "--" in args else len(args)
    found = [word for word in args[:end] if word in GLOBAL]
    return [*found, *(word for word in args[:end] if word not in GLOBAL), *args[end:]]


def changed(name: str, new: str, change: str, text: str) -> str:
    """Value of the new name from that of an old one: a period of a rate, an angle with its unit; others as they are.

    Args:
        name, new: of the option.   change: "1/x" or "deg".   text: that was typed.
    """
    try:
        value = float(text)
    except ValueError:
        return text
    if change == "deg":
        say_new = f"{new} {text}deg"
        found = f"{text}deg"
    else:
        found = f"{1.0 / value:.15g}" if value and isfinite(value) else text
        say_new = f"{new} {found}"
    _say(f"{name} {text}", say_new)
    return found


def path_of(ctx: Any) -> str:
    """Name of a command with that of its group, such as `identify arm`."""
    words: list[str] = []
    while ctx.parent is not None:
        words.insert(0, ctx.info_name)
        ctx = ctx.parent
    return " ".join(words)


def _say(old: str, new: str) -> None:
    note(f"{old} is now {new}; version {UNTIL} refuses the old name")
