"""Pictures of a validation's page, as SVG whose colours are those of the page, light or dark."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armwright.fitting.residuals import parts_of
from armwright.identification.validation.joint_measures import JointMeasures
from armwright.identification.validation.prediction import Prediction
from armwright.results.svg import INK, POINTS, PREDICTED, QUIET, RESIDUAL, SIZE, curve, page_svg, words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FINE = 8  # points to a row of a signal with few rows
WIDE, SMALL = (9.2, 3.9), (4.3, 2.6)  # [inch]


def over_time(prediction: Prediction, column: int) -> str:
    """SVG of a joint's measured and predicted signal over time, the residual below."""

    def draw(figure: Figure) -> None:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
        unit = prediction.units[column]
        y, p = prediction.measured[:, column], prediction.predicted[:, column]
        for k, part in enumerate(parts_of(prediction.part)):
            t = prediction.t[part]
            curves = ((above, y, INK, "measured"), (above, p, PREDICTED, "predicted"), (below, y - p, RESIDUAL, None))
            for axis, values, colour, label in curves:
                drawn = _between(t, values[part]) if prediction.every > 1 else (t, values[part])
                curve(axis, *drawn, colour, label if k == 0 else None)
        words(above, "", f"{prediction.quantity} [{unit}]")
        words(below, "time [s]", f"residual [{unit}]")
        below.yaxis.set_major_formatter("{x:g}")  # a common factor would stand in the picture above
        figure.align_ylabels()
        figure.legend(loc="upper left", ncols=2, borderaxespad=0.1, frameon=False, labelcolor=INK, fontsize=SIZE)

    return page_svg(draw, WIDE)


def spectrum_picture(found: JointMeasures) -> str:
    """SVG of the residual's spectrum beside that of the measured signal; "" if absent."""
    if found.spectrum is None:
        return ""
    from matplotlib.ticker import NullFormatter

    f, e, y = found.spectrum

    def draw(figure: Figure) -> None:
        axis = figure.subplots()
        for power, colour, label in ((y, INK, "measured"), (e, RESIDUAL, "residual")):
            axis.plot(f, np.sqrt(np.maximum(power, 1e-300)), color=colour, linewidth=1.0, label=label)
        top = float(np.sqrt(max(y.max(), e.max(), 1e-300)))
        axis.set(xscale="log", yscale="log", ylim=(1e-6 * top, 3 * top))
        for each in (axis.xaxis, axis.yaxis):  # plain numbers: matplotlib sets powers slowly, as formulas
            each.set_major_formatter(lambda value, _: f"{value:g}")
            each.set_minor_formatter(NullFormatter())
        axis.legend(frameon=False, labelcolor=INK, fontsize=SIZE - 1)
        words(axis, "frequency [Hz]", f"[{found.unit}/√Hz]")

    return page_svg(draw, SMALL)


def friction_picture(found: JointMeasures) -> str:
    """SVG of the residual torque against speed; "" if absent."""
    signature = found.friction
    if signature is None:
        return ""

    def draw(figure: Figure) -> None:
        axis = figure.subplots()
        low, high = signature.mean - signature.std, signature.mean + signature.std
        axis.fill_between(signature.speed, low, high, color=RESIDUAL, alpha=0.2, linewidth=0)
        axis.plot(signature.speed, signature.mean, ".-", color=RESIDUAL, linewidth=1.0, markersize=4)
        axis.axhline(0.0, color=QUIET, linewidth=0.7)
        words(axis, f"speed [{'m/s' if found.unit == 'N' else 'rad/s'}]", f"mean residual [{found.unit}]")

    return page_svg(draw, SMALL)


def correlation_picture(found: JointMeasures) -> str:
    """SVG of the residual's autocorrelation and of its correlation with the input, with 99 % bounds; "" if absent."""
    if found.autocorrelation is None:
        return ""
    shown = [("residual", found.autocorrelation, RESIDUAL)]
    if found.cross is not None:
        shown.append((f"with {found.input_name}", found.cross, PREDICTED))

    def draw(figure: Figure) -> None:
        axes = figure.subplots(1, len(shown), sharey=True, squeeze=False)[0]
        for axis, (label, correlation, colour) in zip(axes, shown, strict=True):
            axis.axhspan(-correlation.bound, correlation.bound, color=QUIET, alpha=0.2, linewidth=0)
            axis.vlines(correlation.lags, 0.0, correlation.values, color=colour, linewidth=1.6)
            axis.set_ylim(-1.05, 1.05)
            words(axis, "lag [rows]", "correlation" if axis is axes[0] else "")
            axis.set_title(label, color=INK, fontsize=SIZE)

    return page_svg(draw, SMALL)


def _between(t: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A filtered and decimated signal with rows between: it is smooth, and straight lines from row to row are not."""
    from scipy.interpolate import CubicSpline

    if not 4 <= len(t) < POINTS // 2 or not np.isfinite(values).all():
        return t, values
    fine = np.linspace(t[0], t[-1], min(FINE * len(t), POINTS // 2))
    return fine, CubicSpline(t, values)(fine)
