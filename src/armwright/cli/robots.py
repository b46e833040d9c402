"""`armwright robots`: the built-in arms."""

from __future__ import annotations

import armwright as aw


def robots() -> None:
    """List the built-in arms.

    Each is a TOML file that can be copied and changed; a path to such a file goes wherever a robot's name does.
    """
    from armwright.cli.tables import console_for_tables, number, table

    rows = []
    for name in aw.builtin_names():
        arm = aw.load(name)
        title = (arm.description.title if arm.description else None) or ""
        drives = dict.fromkeys(body.drive.command for body in arm.coordinates)
        rows.append([name, number(arm.n), ", ".join(drives), title])
    console_for_tables().print(
        table(None, ("name", "joints", "drive", "title"), rows, left=("joints", "drive", "title"))
    )
