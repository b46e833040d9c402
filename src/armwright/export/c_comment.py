"""Comments that every C compiler takes: ASCII, whatever a robot's file or an equation has in it."""

from __future__ import annotations

from collections.abc import Iterable

_WORDS = {
    **dict(
        zip(
            "τθωηλΛΓπΣ∂Δ",
            ("tau", "theta", "omega", "eta", "lambda", "Lambda", "Gamma", "pi", "sum", "d", "delta"),
            strict=True,
        )
    ),
    **dict(zip("·×−–≤≥≈→…√", ("*", "x", "-", "-", "<=", ">=", "~", "->", "...", "sqrt"), strict=True)),
    **dict(zip("⁻¹ᵀ²³½", ("^-", "1", "^T", "^2", "^3", "1/2"), strict=True)),
    "Ṁ": "Mdot",
    "ẋ": "xdot",
    "v̇": "vdot",
    "ω̇": "omegadot",
    "δ": "delta ",
    "q̇": "qd",
    "q̈": "qdd",
    "J̇": "Jdot",
    "*/": "* /",  # the end and the beginning of a comment, and of a trigraph
    "/*": "/ *",
    "??": "? ?",
}


def comment(lines: Iterable[str]) -> str:
    """Those lines as one comment."""
    return "\n".join(["/*", *(f" * {plain(line)}".rstrip() for line in lines), " */"])


def plain(line: str) -> str:
    """A line that can stand in a comment: Greek letters by name, anything else that is not ASCII by number."""
    line = "".join(c if c.isprintable() else " " for c in line)
    for mark in sorted(_WORDS, key=len, reverse=True):
        line = line.replace(mark, _WORDS[mark])
    line = line.encode("ascii", "backslashreplace").decode("ascii")
    return line.replace("*/", "* /").replace("??", "? ?")
