"""The session of the report's `sim`: variables, commands and prompts over one arm.  [SwartzReport]

state.py what a session knows, frozen · variables.py and commands.py its two tables · arguments.py a line's words ·
session.py runs lines · terminal.py asks for them.
"""

from armwright.session.session import Session

__all__ = ["Session"]
