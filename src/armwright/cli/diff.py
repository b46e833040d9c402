"""`armwright diff`: two robot files compared number by number, and the effect on the dynamics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from armwright.cli.tables import console_for_tables, number, table

if TYPE_CHECKING:
    from armwright.quantity import Source
    from armwright.robotfiles import Change
    from armwright.robotfiles.dynamic_effect import DynamicEffect


def _arm(which: str) -> Any:
    help_text = f"The {which}: name of a built-in arm, or path of a robot's TOML, URDF or MJCF file."
    return typer.Argument(metavar="A" if which == "first" else "B", help=help_text, show_default=False)


def diff(a: Annotated[str, _arm("first")], b: Annotated[str, _arm("second")]) -> None:
    """Compare two arms number by number, with the effect on the dynamics.

    The effect is shown as total mass, and the largest changes of gravity torques and inertias (of the mass matrix's
    diagonal, rotors included) at q = 0 and at 32 poses within the limits of A.

    \b
    Examples:
      armwright diff old-arm.toml new-arm.toml
      armwright diff puma560 my-puma.urdf
    """
    import armwright as aw

    difference = aw.robotfiles.diff(a, b)
    console = console_for_tables()
    if not difference:
        console.print(f"{difference.a} and {difference.b}: every parameter and every source is the same")
        return
    values = [change for change in difference.changes if not change.is_source_only]
    rows = [_row(change) for change in values]
    console.print(f"{difference.a} → {difference.b}", style="bold")
    for part in (
        table("Parameters", ("parameter", "A", "B", "change", "source"), rows, left=("A", "B", "source")),
        _sources([change for change in difference.changes if change.is_source_only]),
        None if difference.effect is None else _effect(difference.effect),
    ):
        if part is not None:
            console.print()
            console.print(part)
    if difference.effect is None:
        console.print("\nno joint is in both: gravity torques and inertias are not compared")


def _row(change: Change) -> list[str]:
    sources = [_source(source) for source in (change.source_before, change.source_after) if source is not None]
    origins = " → ".join(dict.fromkeys(sources))
    values = (_value(change.before, change.std_before), _value(change.after, change.std_after))
    return [change.path, *values, _relative(change.before, change.after), origins]


def _source(source: Source) -> str:
    return source.kind if source.kind == source.text else f"{source.kind}: {_short(source.text)}"


def _short(text: str, most: int = 36) -> str:
    return text if len(text) <= most else f"{text[: most - 1].rstrip()}…"


def _value(value: Any, std: Any) -> str:
    """A number, several numbers or a word; with its standard deviation."""
    if value is None:
        return "absent"
    numbers = isinstance(value, (int, float)) and not isinstance(value, bool)
    if isinstance(value, tuple):
        text = f"[{', '.join(_value(item, None) for item in value)}]"
    else:
        text = f"{value + 0.0:.7g}".replace("-", "−") if numbers else str(value)
    return text if std is None else f"{text} ± {_value(std, None)}"


def _relative(before: Any, after: Any) -> str:
    """Of one number, in percent."""
    plain = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in (before, after))
    return _percent(before, after) if plain else ""


def _percent(before: float, after: float) -> str:
    if before == 0:
        return ""
    share = (after - before) / abs(before)
    return f"{100 * share if abs(share) > 1e-12 else 0.0:+.3g} %".replace("-", "−").replace("+0 ", "0 ")


def _sources(changes: list[Change]) -> Any:
    """Numbers that stayed, and come from elsewhere now: one row for each pair of sources."""
    groups: dict[tuple[str, str], list[str]] = {}
    for change in changes:
        groups.setdefault((_origin(change, "before"), _origin(change, "after")), []).append(change.path)
    rows = [[_named(paths), *pair] for pair, paths in groups.items()]
    return table("Same value, other source or deviation", ("parameters", "A", "B"), rows, left=("A", "B"))


def _named(paths: list[str], most: int = 3) -> str:
    rest = f" and {len(paths) - most} more" if len(paths) > most else ""
    return f"{', '.join(paths[:most])}{rest}"


def _origin(change: Change, which: str) -> str:
    source, std = getattr(change, f"source_{which}"), getattr(change, f"std_{which}")
    spread = "" if std is None else f"± {_value(std, None)}, "
    return spread + ("" if source is None else _source(source))


def _effect(effect: DynamicEffect) -> Any:
    heads = ("joint", "gravity A [N m | N]", "gravity B", "change", "inertia A [kg m² | kg]", "inertia B", "change ")
    least = 1e-12 * max(float(abs(effect.gravity).max()), 1.0)
    rows = []
    for k, joint in enumerate(effect.joints):
        gravity = [float(abs(effect.gravity[arm, :, k]).max()) for arm in (0, 1)]
        gravity = [
            number(value if value > least else 0.0) for value in (*gravity, abs(float(effect.gravity_change[k])))
        ]
        inertia = [number(effect.inertia[arm, :, k].max()) for arm in (0, 1)]
        share = float(effect.inertia_change[k])
        percent = "—" if share != share else _percent(1.0, 1.0 + share)
        rows.append([joint, *gravity, *inertia, percent])
    one, other = effect.mass
    mass = f"mass {number(one)} → {number(other)} kg{f' ({_percent(one, other)})' if one else ''}"
    return table(f"What it does, the largest of {len(effect.poses)} poses; {mass}", heads, rows)
