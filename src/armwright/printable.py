"""Text made safe for a terminal: control characters and text-direction marks as backslash escapes."""

from __future__ import annotations

import unicodedata

LINES = "\n\t"  # kept, since they move nothing but the place of the next letter
STEERING = ("Cc", "Cf", "Cs", "Co", "Zl", "Zp")  # controls, formats (bidi overrides, invisible ones), line separators


def printable(text: str) -> str:
    r"""The text with control, format and separator characters escaped: `"\x1b[2J"` → `"\\x1b[2J"`.

    Line feeds and tabs stay.
    """
    if text.isprintable():
        return text
    return "".join(_escaped(letter) if unicodedata.category(letter) in STEERING else letter for letter in text)


def is_seen(text: str) -> bool:
    """True of a text in which every letter is seen and stands where it is read: no controls, no direction marks."""
    return printable(text) == text and not any(letter in text for letter in LINES)


def _escaped(letter: str) -> str:
    if letter in LINES:
        return letter
    code = ord(letter)
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
