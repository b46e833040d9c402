"""Files of an arm in one pose: binary glTF, and a page that turns it, by trimesh's viewer. [DawsonHaggerty2019]"""

from __future__ import annotations

import html
import io
from pathlib import Path
from string import Template

import numpy as np

from armwright.pictures.arm_glb import arm_glb
from armwright.pictures.png import AZIMUTH, ELEVATION, spacing
from armwright.pictures.posed_arm import PosedArm
from armwright.pictures.render import camera
from armwright.results.plot_page import embedded

Y_UP = np.array(
    [[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]]
)  # glTF's y is up, z that of a picture
RESOLUTION, FIELD = (1200, 900), 0.5  # of the page's first view: pixels, and the angle of view [rad]
SQUARES = 24  # of the page's grid along each side

PAGE = Path(__file__).parent / "pages" / "pose.html"  # what is added to trimesh's page: lights, a grid, a line of text


def write_glb(posed: PosedArm, path: Path) -> None:
    """Writes a binary glTF file with a node for every body, named after its link, below the node of its parent."""
    path.write_bytes(_glb(posed))


def write_html(posed: PosedArm, path: Path) -> None:
    """Writes a page without other files: drag to turn the arm, wheel to zoom; three.js is inside, under the MIT licence."""
    import trimesh
    from trimesh.viewer import scene_to_html

    scene = trimesh.load_scene(io.BytesIO(_glb(posed)), file_type="glb")
    corners = posed.surfaces().corners.reshape(-1, 3)
    view = camera(corners, AZIMUTH, ELEVATION, *RESOLUTION, field=FIELD)
    at = np.eye(4)
    at[:3, :3] = view.rotation.T * (1.0, -1.0, -1.0)  # the camera looks along its -z, y up
    at[:3, 3] = view.eye
    scene.camera.resolution = RESOLUTION
    scene.camera.fov = tuple(np.degrees(2 * np.arctan(0.5 * np.array(RESOLUTION) / view.focal)))
    scene.camera_transform = Y_UP @ at
    square = spacing(float(np.linalg.norm(np.ptp(corners, axis=0))))
    floor = min(float(corners[:, 2].min()), 0.0)
    settings = embedded({"title": posed.arm.name, "square": square, "squares": SQUARES, "floor": floor})
    page = scene_to_html(scene).replace("trimesh: threejs viewer", html.escape(posed.arm.name))
    before, _, after = page.rpartition("</body>")
    added = Template(PAGE.read_text(encoding="utf-8")).substitute(settings=settings)
    path.write_text(before + added + after, encoding="utf-8", newline="\n")


def _glb(posed: PosedArm) -> bytes:
    description = posed.arm.description
    base = "base" if description is None else description.base
    return arm_glb(posed.arm, posed.q, posed.shapes, [base, *(body.link for body in posed.arm.bodies)])
