"""Surfaces of solids: closed, facing outward, and of the solid's own volume as far as flat sides can be."""

import numpy as np
import pytest
from pydantic import TypeAdapter

from armwright.description.solids.shapes import Solid
from armwright.pictures.surfaces import ears, extruded, surface

ELL = [[0, 0], [0.2, 0], [0.2, 0.1], [0.1, 0.1], [0.1, 0.2], [0, 0.2]]
SOLIDS = [
    {"shape": "cylinder", "radius_m": 0.1, "length_m": 0.3},
    {"shape": "semi-cylinder", "radius_m": 0.1, "length_m": 0.3},
    {"shape": "box", "size_m": [0.1, 0.2, 0.3]},
    {"shape": "sphere", "radius_m": 0.1},
    {"shape": "prism", "outline_m": ELL, "length_m": 0.3},
    {"shape": "prism", "outline_m": ELL[::-1], "length_m": 0.3},
    {"shape": "tube", "outer_radius_m": 0.1, "inner_radius_m": 0.09, "length_m": 0.3},
    {"shape": "cone", "bottom_radius_m": 0.1, "top_radius_m": 0.05, "length_m": 0.3},
    {"shape": "cone", "bottom_radius_m": 0.1, "top_radius_m": 0, "length_m": 0.3},
    {"shape": "cone", "bottom_radius_m": 0, "top_radius_m": 0.1, "length_m": 0.3},
    {"shape": "ellipsoid", "semi_axes_m": [0.1, 0.2, 0.05]},
]


@pytest.mark.parametrize("told", SOLIDS, ids=lambda told: told["shape"])
def test_closed_outward_and_of_the_right_size(told):
    solid = TypeAdapter(Solid).validate_python(told)
    mesh = surface(solid)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(solid.volume_m3, rel=0.015)  # positive: it faces outward
    assert mesh.center_mass == pytest.approx(solid.centroid_m, abs=1e-3)


def test_ears_cover_a_comb_once():
    teeth = [[x, y] for k in range(6) for x, y in ((k, 0.0), (k + 0.5, 3.0))]
    comb = np.array([*teeth, [6.0, 0.0], [6.0, -1.0], [0.0, -1.0]])[::-1]
    found = ears(comb)
    assert len(found) == len(comb) - 2
    a, b, c = (comb[found[:, k]] for k in range(3))
    areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    assert (areas > 0).all()
    x, y = comb.T
    assert areas.sum() == pytest.approx((x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)
    assert extruded(comb, 2.0).volume == pytest.approx(2 * areas.sum())
