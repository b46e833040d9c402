"""Interactive session after the report's `sim`: variables, commands and prompts over one arm.  [SwartzReport]

`Session` runs lines. `variables.py` and `commands.py` are its two tables, `state.py` its frozen state, `terminal.py` its prompt.
"""

from armwright.session.session import Session

__all__ = ["Session"]
