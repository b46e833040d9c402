"""Fit of a black-box model chosen by name, for the command line."""

from __future__ import annotations

from typing import Any, Literal

from armwright.errors import LogError, check_known
from armwright.identification.linear.fit import fit_armax, fit_arx, fit_oe
from armwright.identification.linear.frequency import FrequencyResponse, frequency_response
from armwright.identification.linear.model import LinearModel
from armwright.identification.linear.n4sid import fit_n4sid
from armwright.identification.linear.records import LogSignals
from armwright.identification.linear.selection import OrderSearch
from armwright.identification.logs.log import Log

FITS = {"arx": fit_arx, "oe": fit_oe, "armax": fit_armax, "n4sid": fit_n4sid}
MODELS = (*FITS, "frequency")


def check_model(model: str, beside: tuple[str, ...] = ()) -> None:
    """Refuses an unknown kind of model.

    Args:
        model: name.   beside: names that are known too.
    Raises:
        LogError: with the names that there are.
    """
    check_known(LogError, model, (*beside, *MODELS), "no such model", place="model")


def fit_linear(
    log: Log,
    model: str,
    signals: LogSignals,
    *,
    order: int | str = "auto",
    delay: int | str = "auto",
    select: Any = "cv",
) -> LinearModel | FrequencyResponse:
    """A black-box model of a log, by the name of its kind.

    Args:
        log: with the runs to fit and to hold out.   model: "arx", "oe", "armax", "n4sid" or "frequency".   signals: of the log.
        order, delay: whole numbers, as numbers or as typed, or "auto".   select: criterion for "auto".
    Returns:
        result: `verdict` of a model says whether it was identified; `str` shows it.
    Raises:
        LogError: no such model, an order that is no number; and as `fit_oe`.
    """
    check_model(model)
    if model == "frequency":
        return frequency_response(log, signals=signals)
    numbers: dict[str, Any] = {"order": _number("order", order), "delay": _number("delay", delay)}
    return FITS[model](log, signals=signals, search=OrderSearch(select), **numbers)


def _number(place: str, text: int | str) -> int | Literal["auto"]:
    """A whole number or "auto".

    Raises:
        LogError: anything else.
    """
    if text == "auto":
        return "auto"
    try:
        return int(text)
    except ValueError:
        raise LogError(place=place, value=text, expected='"auto" or a whole number') from None
