"""Mutations of files: values, lines and tables of a text are replaced, left out, doubled and moved; bytes are damaged."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from random import Random

NUMBER = r"(?<![\w.])[-+]?(?:\d[\d_.]*(?:[eE][-+]?\d+)?|nan|inf)\b"
TOKENS = {  # what a value, a name or a list is, by the kind of text
    "toml": rf'"[^"\n]*"|{NUMBER}|\b(?:true|false)\b|'
    r"(?m:^)[\w-]+(?= *=)|(?<=[{,] )[\w-]+(?= *=)|\[[^\[\]\n=]+\]|\{[^{}\n]*\}",
    "xml": rf'"[^"<\n]*"|</?\w+|\b\w+(?==)|{NUMBER}',
    "csv": r"[^,\n]+",
    "script": r'"[^"\n]*"|[^\s=\[\],]+',
    "mesh": r"\S+",
    "ini": r"(?m:(?<==)[^\n]+$|^[^=\n]+(?==)|^\[[^\n]+\]$)",
}
NUMBERS = (
    *("0", "-0.0", "1", "-1", "2", "0.5", "1e-300", "-1e-300", "5e-324", "1e-160", "1e160", "1e300", "-1e300", "1e308"),
    *("1.7976931348623157e308", "1e309", "-1e400", "nan", "inf", "-inf", "9007199254740993", str(2**31), str(2**63)),
    *(
        str(-(2**64)),
        "9" * 400,
        "9" * 5000,
        "1_000",
        "0x10",
        "1e",
        "1e999999999",
        "00",
        "1,5",
        "true",
        "3.141592653589793",
    ),
)
LONG = 300  # letters: more than a file's name may have
SPECIAL = ("fifo", "loop", "zero", "folder", "gone", "out")  # names of odd entries of a case's folder, with any ending
WORDS = (
    *(
        "",
        " ",
        "a",
        "t",
        "base",
        "none",
        "nan",
        "1",
        "a b",
        "a.b",
        "a[0]",
        "é",
        "\U0001f600",
        "\u202e",
        "\x85",
        "\u2028",
    ),
    *(
        "\x1b[31mred",
        "\x00",
        "\x7f",
        "\n",
        "\\",
        '\\"',
        "%s",
        "{0}",
        "{value}",
        "$HOME",
        "~",
        "~root",
        "..",
        ".",
        "/",
        "//",
    ),
    *(
        "x" * LONG,
        "x" * 5000,
        "\U0001f600" * 100,
        "/etc/hostname",
        "../secret.toml",
        "../../../secret/secret.stl",
        "file:///etc/x",
    ),
    *(
        "package://",
        "package://secret/secret.stl",
        "http://localhost/x.stl",
        "con",
        "nul",
        "__class__",
        "__import__('os')",
    ),
    *(f"{name}.{ending}" for name in SPECIAL for ending in ("toml", "stl", "csv", "sim")),
    *(
        "torque",
        "voltage",
        "current",
        "revolute",
        "prismatic",
        "fixed",
        "two-link",
        "cmu-dd",
        "panda",
        "kg",
        "rad",
        "deg",
    ),
)
FORMULAS = (
    *("1 +", "pi/0", "(-1)**0.5", "sqrt(-1)", "1e308*10", "10**400", "2**2**2**2**2", "sin(t", "t()", "lambda: 0", "[1]", "t[0]"),
    *("log(0)", "fmod(1, 0)", "(-8)**(1/3)", "(1e200)**2", "1j", "1e400", "9**9**9", "abs", "atan2(0,0)", "a.b", "0x10", "1_0"),
    *("(" * 150 + "1" + ")" * 150, "-" * 900 + "1", "+".join("1" * 400), "step(t)**-1", "clip(t,1,0)", "30 deg deg", "'1'"),
)  # fmt: skip
LISTS = ("[]", "[[]]", "[1]", "[0, 0]", "[0, 0, 0]", "[nan, 0, 0]", "[1e300, 1e300, 1e300]", "[1e200, 0, 0]", "[true, 0, 0]",
         '["a", 1, {}]', "[" * 60 + "]" * 60, f"[{'0,' * 5000}]", "{}", "{ value = 1 }", "{ value = nan, std = -1 }",
         "{ joint = 'x' }", "2020-01-01", "12:00:00", '"x"', "1979-05-27T07:32:00Z", "'''\n'''", "''")  # fmt: skip


def mutated(text: str, form: str, rng: Random, others: Sequence[str] = ()) -> bytes:
    """The text with a few changes.

    Args:
        text: a good file.   form: key of `TOKENS`.   rng: decides.   others: texts of the same form, to take lines from.
    """
    for _ in range(rng.choice((0, 1, 1, 1, 1, 2, 4))):
        text = _with_other_token(text, form, rng)
    if rng.random() < 0.3:
        text = _with_other_lines(text, form, rng, rng.choice([text, *others]))
    data = text.encode("utf-8", "surrogatepass")
    return damaged(data, rng) if rng.random() < 0.1 else data


def damaged(data: bytes, rng: Random) -> bytes:
    """The bytes with some flipped, left out, doubled, inserted, or cut off."""
    for _ in range(rng.randint(1, 3)):
        start = rng.randint(0, len(data))
        end = min(len(data), start + rng.choice((1, 1, 2, 4, 8, 64, 1000)))
        junk = (rng.randbytes(end - start), b"\xff" * (end - start), b"\0", b"\xef\xbb\xbf")
        new = rng.choice((b"", b"", data[start:end] * 2, *junk))
        data = data[:start] + new + (b"" if rng.random() < 0.1 else data[end:])
    return data


@lru_cache(maxsize=512)
def _tokens(text: str, form: str) -> tuple[tuple[int, int], ...]:
    return tuple(match.span() for match in re.finditer(TOKENS[form], text))


def _with_other_token(text: str, form: str, rng: Random) -> str:
    tokens = _tokens(text, form)
    if not tokens:
        return text
    start, end = rng.choice(tokens)
    return text[:start] + _replacement(text, text[start:end], tokens, rng) + text[end:]


def _replacement(text: str, token: str, tokens: Sequence[tuple[int, int]], rng: Random) -> str:
    draw = rng.random()
    if draw < 0.25:
        start, end = rng.choice(tokens)
        return text[start:end]
    if draw < 0.3:
        return ""
    # a plausible one, for checks that come late
    if draw < 0.5 and re.fullmatch(r"-?\d+(\.\d*)?([eE][-+]?\d+)?", token):
        return repr(
            float(token) * rng.choice((-1.0, 0.5, 2.0, 1e-3, 1e3, 1.000001)) + rng.choice((0.0, 0.0, 1.0, 1e-9))
        )
    if token[:1] in "[{":
        return rng.choice(LISTS)
    if token[:1] == '"':
        word = rng.choice(rng.choice((WORDS, WORDS, NUMBERS, FORMULAS)))
        return f'"{word}"' if draw < 0.9 else word
    if draw < 0.9 and re.fullmatch(NUMBER, token):
        return rng.choice(NUMBERS) if draw < 0.8 else rng.choice(LISTS)
    return rng.choice(rng.choice((WORDS, NUMBERS, FORMULAS, LISTS)))


def _with_other_lines(text: str, form: str, rng: Random, other: str) -> str:
    """Lines, or tables of a TOML, left out, doubled, exchanged, or taken from another text."""
    split = r"(?m)^(?=\[)" if form == "toml" and rng.random() < 0.5 else r"(?m)^"
    parts, from_other = re.split(split, text), re.split(split, other)
    k, j = rng.randrange(len(parts)), rng.randrange(len(parts))
    draw = rng.randrange(5)
    if draw == 0:
        del parts[k : k + rng.choice((1, 1, 3))]
    elif draw == 1:
        parts.insert(j, parts[k])
    elif draw == 2:
        parts[k], parts[j] = parts[j], parts[k]
    elif draw == 3:
        parts.insert(k, rng.choice(from_other))
    else:
        parts[k : k + 1] = [parts[k]] * rng.choice((2, 3, 50))
    return "".join(parts)
