"""Options of a tuning: the margins that gains keep, and how they are searched for. What is None is the file's, or the default."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from armwright.errors import ScenarioError


@dataclass(frozen=True)
class MarginConstraint:
    """Margins that tuned gains keep at all poses.

    Attributes:
        gain_margin: factor either way that any one command bears, default 2.   phase_margin: [rad], default 30°.
        poses: drawn within the position limits, default 2000; the margins are kept where an inertia or slope is extreme among
            them, with the record's own numbers and the longest delay of the lanes.
    """

    gain_margin: float | None = None
    phase_margin: float | None = None
    poses: int | None = None


@dataclass(frozen=True)
class Search:
    """Method and budget of the search for gains, and the rule by which they are compared.

    Attributes:
        method: "cma", the default, or "differential-evolution".   generations: of the search, default 30.
        candidates: in each; default: 4 + 3 ln k for k gains, and 8 at least.
        front: further searches with other weights of the first two objectives, for the Pareto front; default 0.
        over: "mean", the default, or "worst" of the lanes.
        improve_each: whether no objective may get worse than at the start; default False.
        seed: of the search, the poses and draws, default 0.   client: a `distributed.Client` whose workers simulate.
    """

    method: str | None = None
    generations: int | None = None
    candidates: int | None = None
    front: int | None = None
    over: str | None = None
    improve_each: bool | None = None
    seed: int | None = None
    client: Any = None


def stated(place: str, options: Any, kind: type) -> dict[str, Any]:
    """Fields of options that are stated, by name; none of None.

    Raises:
        ScenarioError: they are of another type.
    """
    if options is None:
        return {}
    if not isinstance(options, kind):
        raise ScenarioError(place=place, value=options, expected=f"aw.tuning.{kind.__name__}(…)")
    return {name: value for name, value in vars(options).items() if value is not None}
