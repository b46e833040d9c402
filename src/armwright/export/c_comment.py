"""Comments that every C compiler takes: ASCII, whatever a robot's file or an equation has in it."""

from __future__ import annotations

from collections.abc import Iterable

_WORDS = {
    **{
        "q̈": "qdd",
        "q̇": "qd",
        "Ṁ": "Mdot",
        "J̇": "Jdot",
        "⁻": "^-",
        "¹": "1",
        "ᵀ": "^T",
        "²": "^2",
        "³": "^3",
        "½": "1/2",
    },
    **{
        "τ": "tau",
        "θ": "theta",
        "ω": "omega",
        "η": "eta",
        "λ": "lambda",
        "π": "pi",
        "Σ": "sum",
        "∂": "d",
        "Δ": "delta",
    },
    **{"·": "*", "×": "x", "−": "-", "–": "-", "≤": "<=", "≥": ">=", "≈": "~", "→": "->", "…": "...", "√": "sqrt"},
    **{"*/": "* /", "/*": "/ *", "??": "? ?"},  # the end and the beginning of a comment; a trigraph
}


def comment(lines: Iterable[str]) -> str:
    """Those lines as one comment."""
    return "\n".join(["/*", *(f" * {plain(line)}".rstrip() for line in lines), " */"])


def plain(line: str) -> str:
    """A line that can stand in a comment: Greek letters by name, anything else that is not ASCII by number."""
    for mark, word in _WORDS.items():
        line = line.replace(mark, word)
    line = "".join(c if c.isprintable() else " " for c in line)
    return line.encode("ascii", "backslashreplace").decode("ascii").replace("*/", "* /")
