"""Displayed equations, which docstrings and pages write as text, as formulas: MathML, which browsers draw by themselves.

A fence with the language `equation` becomes formulas, and nothing else does:

    ```equation
    C_w Ṫ_w = R i² - (T_w - T_h) / R_w       the winding
    ```

A line is a row; the rows of a paragraph share their columns. Two spaces or more begin a column; after a comma, semicolon or colon
they are a gap. A letter is a variable, with its dots; a word is upright; `_` and `^` begin an index and an exponent of one word,
or of all between { }. A space between two factors is a product, √ takes the factor behind it, text between backticks is code, and
so is a name such as rest_speed.
"""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from html import escape

from docutils import nodes
from sphinx.application import Sphinx

FENCE = "equation"
FUNCTIONS = "PI clip cos det diag exp log max mean min round sat sgn sin tan var"
ACCENTS = {"\u0302": "^", "\u0303": "~", "\u0304": "¯", "\u0307": "˙", "\u0308": "¨"}
SYMBOL = r"(?:tau|[A-Z][a-z]|k[pivd]|vs|d[it])(?![A-Za-z])"  # τ; Kt, kp, vs: a letter with an index; dt: two letters
WORD = rf"(?!{SYMBOL})[A-Za-z]{{2,}}(?!\w)"
TOKEN = re.compile(
    rf"""(?P<space>\s+) | (?P<code>`[^`]+`(?:-\w+)?|(?!tau_)[A-Za-z]{{3,}}(?:_[A-Za-z]+)*_[A-Za-z_]{{3,}})
    | (?P<number>\d+(?:\.\d+)?(?:e[-−]?\d+)?|[½∞]) | (?P<up>[⁰¹²³⁴-⁹⁺⁻ᵀⁿ]+|['′]|\*(?![\w(])) | (?P<down>[₀-₉₊₋ᵢⱼₖₙ]+)
    | (?P<word>{WORD}(?:(?:[ ]a)?[ -]{WORD})*|(?!{SYMBOL})[A-Za-z]{{2,}}) | (?P<symbol>{SYMBOL})
    | (?P<sum>[Σ∏∫]) | (?P<letter>(?:[^\W\d_]|∂)[\u0300-\u036f]*) | (?P<script>[_^](?:\{{|(?:[^\W_][\u0300-\u036f]*)+))
    | (?P<open>[(\[]) | (?P<close>[)\]}}]) | (?P<bar>\|) | (?P<root>√) | (?P<mark>[,;:.…])
    | (?P<operator>\+=|[^\w\s{{}}])""",
    re.VERBOSE,
)
CLOSING = {"(": ")", "[": "]", "|": "|"}
PRODUCT, WIDE, COLUMN = "0.17em", "0.28em", "2em"


def setup(app: Sphinx) -> dict[str, bool]:
    """Connects the extension."""
    app.connect("doctree-read", draw_fences)
    return {"parallel_read_safe": True}


def draw_fences(app: Sphinx, tree: nodes.document) -> None:
    """Puts formulas into the place of fences with the language `equation`."""
    for node in [each for each in tree.findall(nodes.literal_block) if each.get("language") == FENCE]:
        node.replace_self(nodes.raw("", f'<div class="equation">{mathml(node.astext())}</div>', format="html"))


def mathml(text: str) -> str:
    """A block of equations: an element `math` for each paragraph, with a row for each line.

    Raises:
        ValueError: a bracket or a bar without its partner.
    """
    return "".join(_paragraph(each) for each in re.split(r"\n\s*\n", text.strip("\n")))


def _paragraph(text: str) -> str:
    rows = []
    for line in unicodedata.normalize("NFC", text).splitlines():
        cells = [Formula(cell).drawn for cell in re.split(r"(?<![,;:\s])\s{2,}", line.strip())]
        cells[0] = _space(COLUMN) * line.startswith(" ") + cells[0]
        rows.append(f"<mtr>{''.join(f'<mtd>{cell}</mtd>' for cell in cells)}</mtr>")
    return f'<math display="block" alttext="{escape(text)}"><mtable displaystyle="true">{"".join(rows)}</mtable></math>'


@dataclass
class Item:
    """A token, or a bracket with all that it holds: its kind, how it is drawn, its index and its exponent."""

    kind: str
    base: str
    down: str = ""
    up: str = ""

    @property
    def drawn(self) -> str:
        """As MathML."""
        under, over = ("munder", "mover") if self.kind == "sum" else ("msub", "msup")
        if self.down and self.up:
            return f"<msubsup>{self.base}<mrow>{self.down}</mrow><mrow>{self.up}</mrow></msubsup>"
        tag, script = (under, self.down) if self.down else (over, self.up)
        return f"<{tag}>{self.base}<mrow>{script}</mrow></{tag}>" if script else self.base


class Formula:
    """An equation, or the words beside one, read from left to right.

    Attributes:
        drawn: as an element `mrow`.
    """

    def __init__(self, text: str) -> None:
        self._text, self._at = text, 0
        self.drawn = self._row("")

    def _row(self, end: str) -> str:
        """All up to the sign `end`."""
        items: list[Item] = []
        spaces = ""
        while self._at < len(self._text):
            kind, text = self._next()
            if text == end:
                break
            index = kind == "number" and not spaces and items and items[-1].kind == "letter"  # σ0
            if kind == "space":
                spaces = text
            elif kind in ("up", "down", "script") or index:
                self._attach(items, kind, text)
            else:
                items += self._items(kind, text, items[-1] if items else Item("operator", ""), spaces)
                spaces = ""
        else:
            if end:
                raise ValueError(f"no {end} in the equation {self._text!r}")
        return f"<mrow>{''.join(item.drawn for item in items)}</mrow>"

    def _next(self) -> tuple[str, str]:
        token = TOKEN.match(self._text, self._at)
        if token is None or token.lastgroup is None:
            raise ValueError(f"{self._text[self._at]!r} in the equation {self._text!r} is none of its signs")
        self._at = token.end()
        return token.lastgroup, token[0]

    def _attach(self, items: list[Item], kind: str, text: str) -> None:
        """An index or an exponent of the last item."""
        if not items:
            raise ValueError(f"{text} without a base in the equation {self._text!r}")
        item = items[-1]
        if text in ("_{", "^{"):
            drawn = self._row("}")
        elif kind == "script":
            word = text[1:]
            drawn = f"<mi>{word}</mi>" if len(word) > 2 and word.isascii() else _letters(word)
        elif text in "'′*":
            drawn = f"<mo>{'∗' if text == '*' else '′'}</mo>"
        else:
            drawn = "".join(_letters(each) for each in unicodedata.normalize("NFKC", text))
        if kind == "up" or text[0] == "^":
            item.up += drawn
        else:
            item.down += f"<mo separator='true'>,</mo>{drawn}" if item.down else drawn

    def _items(self, kind: str, text: str, before: Item, spaces: str) -> list[Item]:
        """A token with the space before it."""
        item = self._item(kind, text, before, spaces)
        if not spaces or "operator" in (before.kind, kind):
            return [item]
        width = WIDE if {"word", "code", "mark"} & {before.kind, kind} else PRODUCT
        return [Item("gap", _space(COLUMN if len(spaces) > 1 else width)), item]

    def _item(self, kind: str, text: str, before: Item, spaces: str) -> Item:
        match kind:
            case "code":
                return Item(kind, f'<mtext class="code">{escape(text.replace("`", ""))}</mtext>')
            case "word" if text in FUNCTIONS.split():
                return Item("letter", f"<mi>{text}</mi>")
            case "word" | "mark":
                return Item(kind, f"<mtext>{text.replace(' ', chr(0xA0))}</mtext>")
            case "symbol" if text == "tau":
                return Item("letter", "<mi>τ</mi>")
            case "symbol" if text[0] == "d":
                return Item("letter", f"<mrow>{_letters(text)}</mrow>")
            case "symbol":
                return Item("letter", _letters(text[0]), _letters(text[1]))
            case "open" | "bar":
                end = CLOSING[text]
                return Item(
                    "bracket", f"<mrow>{_bracket(text, 'prefix')}{self._row(end)}{_bracket(end, 'postfix')}</mrow>"
                )
            case "root":
                kind, text = self._next()
                held = self._row(")") if text == "(" else self._item(kind, text, before, "").base
                return Item("bracket", f"<msqrt>{held}</msqrt>")
            case "close":
                raise ValueError(f"{text} without a partner in the equation {self._text!r}")
            case "operator":
                form = " form='prefix'" if before.kind in ("operator", "mark") else ""
                close = " lspace='0' rspace='0'" if text == "/" and not spaces else ""
                return Item(kind, f"<mo{form}{close}>{escape({'-': '−', '*': '∗'}.get(text, text))}</mo>")
            case "sum":
                return Item(kind, f"<mo movablelimits='false'>{text.replace('Σ', '∑')}</mo>")
        return Item(kind, _letters(text))


def _letters(text: str) -> str:
    """Letters one by one with their accents, a number, or a sign."""
    if text[0].isdigit() or text in "½∞":
        return f"<mn>{text}</mn>"
    if text in "+−":
        return f"<mo form='prefix'>{text}</mo>"
    drawn = ""
    for letter, mark in re.findall(r"(\w|∂)([\u0300-\u036f]?)", unicodedata.normalize("NFD", text)):
        upright = " mathvariant='normal'" if "Α" <= letter <= "Ω" else ""
        base = f"<mi{upright}>{letter}</mi>"
        accent = f"<mo stretchy='false'>{ACCENTS[mark]}</mo>" if mark else ""
        drawn += f"<mover accent='true'>{base}{accent}</mover>" if accent else base
    return drawn


def _bracket(text: str, form: str) -> str:
    return f"<mo stretchy='false' form='{form}'>{text}</mo>"


def _space(width: str) -> str:
    return f"<mspace width='{width}'/>"
