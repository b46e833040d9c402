"""Report of an identification or of a validation as one HTML page that needs no network."""

from __future__ import annotations

import os
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from armwright.identification.validation.joint_measures import JointMeasures
from armwright.identification.validation.limits import Check
from armwright.identification.validation.pictures import (
    correlation_picture,
    friction_picture,
    over_time,
    spectrum_picture,
)
from armwright.results.page_parts import bullets, html_table, section, sentence, shown_table, write_page

if TYPE_CHECKING:
    from armwright.identification.estimate import Estimate
    from armwright.identification.validation.validate import Validation
    from armwright.results.table import Table

MOST_PLACES = 6  # behind the point
STRONG = 0.95  # correlation from which on two parameters are named
PAIRS = 12  # of strongly correlated parameters that are listed
SMALL = 1e-3  # of a probability: less is shown as that
BOUNDS = "beyond 99 % bounds"
DRAWN = 2  # runs of each joint that are drawn
MEASURES = (
    ("R²", "1 − ‖e‖² / ‖y − ȳ‖²: the share of the signal's power that is explained; below 0 the mean would be better"),
    ("fit", "100 (1 − ‖e‖ / ‖y − ȳ‖) %: the share of its amplitude; NRMSE is 1 − fit / 100"),
    ("VAF", "100 (1 − var e / var y) %: as R², but a constant error is forgiven"),
    ("white", "p of Ljung and Box's test: how likely correlations this large are, if nothing is left in the residual but noise"),
    ("delay", "of the measured behind the predicted signal, in samples of the log, ± its standard deviation"),
    ("at rest", "a joint that stands still has nothing that a model could explain: its mean values are given instead"),
)  # fmt: skip


def write_report(
    path: str | os.PathLike[str],
    title: str,
    estimate: Estimate | None = None,
    validation: Validation | None = None,
    sections: Sequence[tuple[str, str]] = (),
    fits: Sequence[Table] | None = None,
) -> Path:
    """Writes a report: verdict and summary first, then what to do next, parameters, joints with their plots, and the method.

    Args:
        path: ending in .html.   title: of the page.   estimate: of the parameters, if some were fitted.
        validation: on a log, if there was one.
        sections: further ones, each a heading and its HTML: what a fit adds of its own.
        fits: tables of how well it fits; by default the estimate's.
    Returns:
        path: of the page, one file that needs no network; light or dark as the reader's system is.
    Raises:
        OutputError: the file cannot be written.
    """
    of = "" if validation is None or validation.log.title in title else validation.log.title
    return write_page(path, title, report_blocks(estimate, validation, sections, fits), of)


def report_blocks(
    estimate: Estimate | None = None,
    validation: Validation | None = None,
    sections: Sequence[tuple[str, str]] = (),
    fits: Sequence[Table] | None = None,
) -> list[str]:
    """Sections of the page as HTML; see `write_report`."""
    blocks = [_summary(estimate, validation)] if estimate is not None or validation is not None else []
    if validation is not None:
        blocks.append(section("Every joint", _measures(validation)))
    next_steps = steps(estimate, validation)
    if next_steps:
        blocks.append(section("What to do next", bullets(map(sentence, next_steps))))
    if estimate is not None:
        blocks.append(section("Parameters", _parameters(estimate, fits)))
    blocks += [section(heading, html) for heading, html in sections]
    if validation is not None:
        blocks += [_joint(validation, joint) for joint in validation.arm.names]
        blocks.append(section("How this was measured", _method(validation)))
    return blocks


def steps(estimate: Estimate | None, validation: Validation | None) -> list[str]:
    """Next steps for the findings, in words, the gravest first."""
    found = [] if estimate is None else list(estimate.remarks)
    if validation is None:
        return found
    for each in validation.measures:
        found += [f"{each.quantity} of {each.joint}: {remark}" for remark in each.remarks]
    missing = {term.name for each in validation.measures if each.friction for term in each.friction.missing}
    if missing & {"Coulomb", "viscous", "Stribeck"}:
        found.append("Friction is missing or too large: `armwright identify friction` fits it to the same log.")
    if missing & {"inertia"}:
        found.append("Inertia is missing or too large: identify the arm again, with the rotors free.")
    if not validation.held_out:
        found.append(
            'Mark a run that no fit has seen use = "hold-out" in the log, and validate again: this verdict is too optimistic.'
        )
    if validation.passed and not found and (estimate is None or estimate.verdict == "identified"):
        found.append(
            "Nothing stands out: the record predicts this log. It says nothing about other speeds, loads and poses."
        )
    return found


def _summary(estimate: Estimate | None, validation: Validation | None) -> str:
    """The verdict, and facts about it: that of a fit judges the record too, limits kept or missed are facts beside it."""
    lines, facts = [], {}
    if estimate is not None:
        facts = {"Log": f"{estimate.log} {_short(estimate.sha256)}"}
        good = " good" if estimate.verdict == "identified" else ""
        lines.append(
            f'<p class="verdict{good}">{escape(estimate.verdict.capitalize())}</p><p>{escape(estimate.method)}</p>'
        )
    if validation is not None:
        good = " good" if validation.passed else ""
        if estimate is None:
            lines.append(f'<p class="verdict{good}">{escape(validation.arm.name)} {escape(validation.verdict)}</p>')
        record = "made in Python or built in" if validation.record is None else validation.record.name
        runs = ", ".join(validation.runs) if len(validation.runs) <= 8 else f"{len(validation.runs)} runs"
        facts = {
            "Record": f"{record} {_short(validation.record_sha256)}",
            "Log": f"{validation.log.path.name} {_short(validation.log.sha256)}",
            "Judged": f"{runs}, {'not used for fitting' if validation.held_out else 'not held out'}",
            "Limits": _limits(validation),
            "Kept": f"{sum(check.passed for check in validation.checks)} of {len(validation.checks)} limits",
            "Date": validation.date,
        }
    lines.append("<dl>" + "".join(f"<dt>{k}</dt><dd>{escape(v)}</dd>" for k, v in facts.items()) + "</dl>")
    return f"<section>{''.join(lines)}</section>"


def _short(sha256: str) -> str:
    return f"(sha256 {sha256[:12]}…)" if sha256 else ""


def _limits(validation: Validation) -> str:
    """The limits in one line."""
    tables = validation.limits.model_dump(exclude_none=True, exclude_defaults=True)
    tables |= {
        f"{joint}.{quantity}": each for joint, own in tables.pop("joints", {}).items() for quantity, each in own.items()
    }
    texts = [f"{name}.{key} = {value:g}" for name, table in tables.items() for key, value in table.items()]
    judged = sorted({check.quantity for check in validation.checks})
    default = f" (default; judged: {', '.join(judged) or 'nothing'})" if validation.by_default else ""
    return f"{', '.join(texts)}{default}"


def _measures(validation: Validation) -> str:
    """Table of all measures, a row for each joint and quantity."""
    heads = (
        "joint", "quantity", "R²", "fit [%]", "VAF [%]", "RMS", "unit", "RMS of runs", "delay [rows]", "white", "limits",
    )  # fmt: skip
    several = any(len(each.runs) > 1 for each in validation.measures)
    rows = []
    for each in validation.measures:
        name = f'<a href="#{escape(each.joint)}">{escape(each.joint)}</a>'
        if not each.runs:
            rows.append([name, each.quantity, "at rest", *[""] * 3, each.unit, *[""] * 3, _at_rest(each)])
            continue
        a, (low, high) = each.overall, each.spread
        values = [f"{a.r2:.3f}", f"{a.fit:.1f}", f"{a.vaf:.1f}", f"{a.rms:.4g}", each.unit]
        spread = f"{low:.3g} … {high:.3g}" if len(each.runs) > 1 else ""
        delay = "" if each.delay is None else " ± ".join(_rounded(each.delay.samples, each.delay.std, 2))
        white = "" if each.whiteness is None else escape(_probability(each.whiteness.p))
        judged = (check for check in validation.checks if (check.joint, check.quantity) == (each.joint, each.quantity))
        rows.append([name, each.quantity, *values, spread, delay, white, "<br>".join(map(_judged, judged))])
    if not several:  # an empty column
        heads, *rows = [[*row[:7], *row[8:]] for row in (heads, *rows)]
    return html_table(heads, rows, (0, 1, 6, len(heads) - 1))


def _rounded(value: float, std: float, digits: int) -> tuple[str, str]:
    """A number and its standard deviation to so many digits of the latter; "" for one that is not known."""
    if not np.isfinite(std) or std <= 0:
        return f"{value:.6g}".replace("-", "−"), f"{std:g}" if std == 0 else ""
    places = digits - 1 - int(np.floor(np.log10(std)))
    if places > MOST_PLACES:  # of small units: powers of ten
        return f"{value:.4g}".replace("-", "−"), f"{std:.{digits}g}".replace("-", "−")
    first, second = (f"{round(each, places):.{max(places, 0)}f}" for each in (value, std))
    return first.replace("-", "−"), second


def _judged(check: Check) -> str:
    sign, colour = ("✓", "good") if check.passed else ("✗", "bad")
    return f'<span class="{colour}">{sign} {escape(str(check))}</span>'


def _at_rest(found: JointMeasures) -> str:
    """Means of the first runs in which a joint stands still."""
    few = list(found.at_rest.items())[:3]
    texts = (f"{k}: measured {v.measured:.3g}, predicted {v.predicted:.3g} {found.unit}" for k, v in few)
    return escape("; ".join(texts))


def _parameters(estimate: Estimate, fits: Sequence[Table] | None) -> str:
    """Table of the estimated numbers, then strong correlations and measures of the fit."""
    parameters, *own = estimate.tables()
    parts = [shown_table(parameters)]
    matrix = estimate.correlation
    pairs = sorted(np.argwhere(np.triu(np.abs(matrix), 1) > STRONG), key=lambda pair: -abs(matrix[tuple(pair)]))
    if pairs:
        named = [f"{estimate.names[i]} and {estimate.names[j]}: {matrix[i, j]:.3f}" for i, j in pairs[:PAIRS]]
        parts.append(f"<h3>Strong correlations</h3>{bullets(named)}")
    parts += [f"<h3>Fit to the log</h3>{shown_table(each)}" for each in (own if fits is None else fits)]
    if np.isfinite(estimate.condition):
        parts.append(f'<p class="quiet">Condition number {estimate.condition:.4g}.</p>')
    return "".join(parts)


def _joint(validation: Validation, joint: str) -> str:
    """Plots and words of one joint, those of the first quantity open."""
    column, inner = validation.arm.names.index(joint), []
    for number, each in enumerate(each for each in validation.measures if each.joint == joint):
        runs = {p.run: p for p in validation.predictions if p.quantity == each.quantity}
        shown = list(dict.fromkeys([each.worst or next(iter(runs)), *runs]))[: 1 if number else DRAWN]
        parts = []
        for name in shown:
            worst = " (the largest residual)" if len(runs) > 1 and name == each.worst else ""
            parts.append(f"<h3>{each.quantity.capitalize()}, run {escape(name)}{worst}</h3>")
            parts.append(f'<div class="plot">{over_time(runs[name], column)}</div>')
        pictures = [svg for svg in (spectrum_picture(each), friction_picture(each), correlation_picture(each)) if svg]
        parts.append(f'<div class="small">{"".join(f"""<div class="plot">{svg}</div>""" for svg in pictures)}</div>')
        parts += [bullets(map(sentence, each.remarks)), _tests(each)]
        text = "\n".join(parts)
        inner.append(f"<details><summary>{each.quantity.capitalize()}</summary>{text}</details>" if number else text)
    return section(joint, "\n".join(inner), joint) if inner else ""


def _tests(found: JointMeasures) -> str:
    """The residual's tests in words; they are no part of the verdict."""
    texts = []
    if found.whiteness is not None and found.autocorrelation is not None:
        w, beyond = found.whiteness, 100 * found.autocorrelation.outside
        p = f"p {'' if w.p < SMALL else '= '}{_probability(w.p)}"
        texts.append(
            f"Ljung–Box over {w.lags} lags: Q = {w.q:.4g}, {p}; {beyond:.0f} % of the autocorrelations {BOUNDS}."
        )
    if found.cross is not None:
        (lag, value), beyond = found.cross.largest, 100 * found.cross.outside
        texts.append(
            f"Largest correlation with the {found.input_name} {value:.2f} at lag {lag}; {beyond:.0f} % {BOUNDS}."
        )
    if found.at_rest and found.runs:
        texts.append(f"At rest: {_at_rest(found)}.")
    return f'<p class="quiet">{escape(" ".join(texts))}</p>' if texts else ""


def _method(validation: Validation) -> str:
    """Method of the predictions, and definitions of the measures."""
    notes = [*validation.notes, "Tests of residuals are reported and never decide: what is filtered is never white"]
    terms = "".join(f"<dt>{name}</dt><dd>{escape(about)}</dd>" for name, about in MEASURES)
    symbols = "y is measured, ŷ predicted, e = y − ŷ the residual, ȳ the mean of y."
    return f'{bullets(map(sentence, notes))}<p class="quiet">{symbols}</p><dl>{terms}</dl>'


def _probability(p: float) -> str:
    return "< 0.001" if p < SMALL else f"{p:.2g}"
