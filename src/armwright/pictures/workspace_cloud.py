"""A page with the point cloud of a workspace, coloured by manipulability, to turn with the mouse."""

from __future__ import annotations

import html
from pathlib import Path
from string import Template
from typing import TYPE_CHECKING

import numpy as np

from armwright.pictures.png import spacing
from armwright.results.plot_page import embedded

if TYPE_CHECKING:
    import xarray as xr

POINTS = 60_000  # of the cloud; more hide each other and make the page slow
SIZE = 1.0 / 170.0  # of a point, as a share of the cloud
CUT = 99.0  # percentile of the manipulability that gets the last colour
STEPS = 9  # colours of the scale in the legend
Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])  # glTF's y is up
SQUARES = 24  # of the page's grid along each side
PAGE = Path(__file__).parent / "pages" / "cloud.html"


def cloud_page(dataset: xr.Dataset, unit: str, flat: bool) -> str:
    """HTML page of 60,000 samples, with three.js (MIT licence).

    Those in the quarter x > 0, y < 0 are left out, so that the inside shows, unless the cloud is flat.

    Args:
        dataset: what `workspace` returned.   unit: of the manipulability, to be read.   flat: True for tips in a plane.
    """
    import trimesh
    from matplotlib import colormaps
    from matplotlib.colors import to_hex
    from trimesh.viewer import scene_to_html

    points, w = dataset.position.values, dataset.manipulability.values
    cut = (points[:, 0] > 0.0) & (points[:, 1] < 0.0)  # the quarter before the camera
    if cut.all() or flat:  # an arm that moves in this quarter alone, or in a plane
        cut = np.zeros(len(points), dtype=bool)
    kept = np.flatnonzero(~cut)[:POINTS]
    points, w = points[kept], w[kept]
    most = max(float(dataset.manipulability_percentiles.sel(percentile=CUT)), np.finfo(float).tiny)
    viridis = colormaps["viridis"]
    colours = (255 * viridis(np.minimum(w / most, 1.0))).astype(np.uint8)
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.PointCloud(points @ Y_UP[:3, :3].T, colours))
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    a = dataset.attrs
    without = ", the quarter x > 0, y < 0 left out" if cut.any() else ""
    words = f"{len(points):,} of {a['samples']:,} joint positions{without}, {a['aim']} of {a['frame']}"
    settings = {
        "title": f"{a['arm']}: workspace",
        "words": f"{a['arm']}: {words}",
        "size": SIZE * size,
        "square": spacing(size),
        "squares": SQUARES,
        "scale": ["manipulability 0", f"{most:.2g} {unit} and more"],
        "colours": [to_hex(viridis(k / (STEPS - 1))) for k in range(STEPS)],
    }
    page = scene_to_html(scene).replace("trimesh: threejs viewer", html.escape(settings["title"]))
    before, _, after = page.rpartition("</body>")
    return before + Template(PAGE.read_text(encoding="utf-8")).substitute(settings=embedded(settings)) + after
