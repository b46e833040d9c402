"""`armwright robots`: the built-in arms."""

from __future__ import annotations


def robots() -> None:
    """List the built-in arms.

    Each is a TOML file that can be copied and changed; a path to such a file goes wherever a robot's name does.
    """
    from rich.table import Table
    from rich.text import Text

    import armwright as aw
    from armwright.cli.tables import console_for_tables

    table = Table("name", "joints", "drive", "title", box=None, header_style="bold", pad_edge=False)
    for name in aw.builtin_names():
        arm = aw.load(name)
        title = (arm.description.title if arm.description else None) or ""
        drives = dict.fromkeys(body.drive.command for body in arm.coordinates)
        table.add_row(Text(name, style="bold"), Text(str(arm.n)), Text(", ".join(drives)), Text(title))
    console_for_tables().print(table)
