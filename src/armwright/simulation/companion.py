"""Global error of a run: a few of its lanes simulated again with a tenth of the tolerance, without effect on the run.

The difference d(t) of the two is nearly the error of the run, as the companion's is a tenth of it; `SAFETY` covers what is left.
Errors of most motions grow with a power of time. Of a sensitive one they grow as exp(λ t), λ being its largest exponent: each
digit of accuracy then buys ln(10)/λ seconds, and behind the last digit there is none to buy.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armwright.results.notes import notes_of
from armwright.signals import Layout
from armwright.simulation.integrate.step_control import floors
from armwright.simulation.integrate.stepping import LEAST_ACCURACY

if TYPE_CHECKING:
    import xarray

FINER = 0.1  # of the accuracy, for the companion
SAFETY = 2.0  # estimates in differences: by itself a difference is 0.6 to 1.1 of the error
LANES = 3  # that are simulated once more: the one of the most steps, and its neighbours
GROWN = 30.0  # times as large at the end as at half time: more than any power of time below the fifth
LARGEST_DIFFERENCE = 0.03  # of a range: larger differences no longer grow as small ones do


@dataclass(frozen=True, eq=False)
class GlobalError:
    """Estimated errors of a run's integration.

    Attributes:
        by_quantity: by the name of each signal of the state, in parts of its range.   accuracy: that was asked for.
        exceeded: [s] from when on they are above it; None: they are not.
        exponent: λ [1/s] of a sensitive motion; None of another one.
    """

    by_quantity: dict[str, float]
    accuracy: float
    exceeded: float | None
    exponent: float | None

    @classmethod
    def of(
        cls, t: np.ndarray, ours: np.ndarray, finer: np.ndarray, layout: Layout, accuracy: float
    ) -> GlobalError | None:
        """The errors of rows that belong to the same times.

        Args:
            t: (rows,) [s].   ours, finer: (rows, lanes, nx) of the run and the companion.   layout: of x.
        Returns:
            None where a lane has stopped.
        """
        if not (np.isfinite(ours).all() and np.isfinite(finer).all()):
            return None
        ranges = np.maximum(np.ptp(ours, axis=0), floors(layout))
        differences = SAFETY * np.abs(ours - finer) / ranges
        by_quantity = {name: float(differences[..., layout.place(name)].max(initial=0.0)) for name in layout.names}
        largest = np.maximum.accumulate(differences.max(axis=(1, 2), initial=0.0))
        above = np.flatnonzero(largest > accuracy)
        if not len(above):
            return cls(by_quantity, accuracy, None, None)
        return cls(by_quantity, accuracy, float(t[above[0]]), _exponent(t, largest))

    def add_to(self, run: xarray.Dataset) -> None:
        """Adds them to a run, and a note where they are above the accuracy."""
        about = "estimated error of the integration, in parts of the range"
        run["global_error"] = ("quantity", list(self.by_quantity.values()), {"units": "1", "long_name": about})
        run.coords["quantity"] = ("quantity", list(self.by_quantity))
        if self.exceeded is not None:
            run.attrs["notes"] = "\n".join([*notes_of(run), self._note(self.exceeded)])

    def _note(self, exceeded: float) -> str:
        """Note for users about errors that exceed the accuracy from some time [s] on."""
        name, largest = max(self.by_quantity.items(), key=lambda item: item[1])
        found = (
            f"errors of integration reach {largest:.2g} of the range of {name}, above the accuracy of {self.accuracy:g} from "
            f"t = {exceeded:.3g} s on"
        )
        if self.exponent is not None:
            last = exceeded + np.log(self.accuracy / LEAST_ACCURACY) / self.exponent
            return (
                f"{found}; the motion is sensitive, errors grow tenfold every {np.log(10.0) / self.exponent:.2g} s: no accuracy "
                f"holds beyond t = {last:.3g} s"
            )
        enough = 10.0 ** np.floor(np.log10(0.5 * self.accuracy**2 / largest))
        return f"{found}; accuracy = {enough:.0e} would do" if enough >= LEAST_ACCURACY else found


def lanes_again(count: int, steps: np.ndarray) -> range:
    """Numbers of the lanes of a run of so many that are simulated once more, from the steps (lanes,) that each has tried."""
    first = min(max(int(np.argmax(steps)) - 1, 0), max(count - LANES, 0))
    return range(first, min(first + LANES, count))


def _exponent(t: np.ndarray, largest: np.ndarray) -> float | None:
    """λ [1/s] of differences (rows,) that grow as no power of time does; None of others."""
    end = min(int(np.argmax(largest > LARGEST_DIFFERENCE)) or len(t) - 1, len(t) - 1)
    half = int(np.searchsorted(t, 0.5 * (t[0] + t[end])))
    if not 0 < half < end or largest[half] <= 0.0 or largest[end] < GROWN * largest[half]:
        return None
    return float(np.log(largest[end] / largest[half]) / (t[end] - t[half]))
