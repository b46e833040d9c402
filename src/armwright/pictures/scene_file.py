"""A still for other programs and for browsers: binary glTF, and a page that turns it. Through trimesh. [DawsonHaggerty2019]"""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import Any

import numpy as np

from armwright.model import BASE
from armwright.pictures.animated import linear
from armwright.pictures.png import AZIMUTH, ELEVATION, spacing
from armwright.pictures.render import camera
from armwright.pictures.still import Still, node_name

Y_UP = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])  # glTF's y is up, the arm's z
RESOLUTION, FIELD = (1200, 900), 0.5  # of the page's first view: pixels, and the angle of view [rad]
SQUARES = 24  # of the page's grid along each side

PAGE = """<script>
(function lights() {{
  if (typeof controls === "undefined" || !controls) return void setTimeout(lights, 20);
  const told = {told};
  document.title = told.title;
  scene.background = new THREE.Color(0xf7f7f5);
  renderer.outputEncoding = THREE.sRGBEncoding;
  tracklight.intensity = 0.4;
  const sun = new THREE.DirectionalLight(0xffffff, 0.6);
  sun.position.set(-1, 3, 1.5);
  scene.add(sun);
  scene.add(new THREE.HemisphereLight(0xffffff, 0xb9b3aa, 0.45));
  const grid = new THREE.GridHelper(told.squares * told.square, told.squares, 0xb0aeaa, 0xdcdad6);
  grid.position.y = told.floor;
  scene.add(grid);
  camera.near = told.square / 50;
  camera.far = told.square * 2000;
  camera.updateProjectionMatrix();
  const label = document.createElement("div");
  label.textContent = told.title + " · a square of the grid is " + told.square + " m · drag to turn, wheel to zoom";
  label.style.cssText = "position:fixed;left:14px;bottom:12px;font:13px system-ui,sans-serif;color:#555";
  document.body.appendChild(label);
  render();
}})();
</script>
</body>"""


def write_glb(still: Still, path: Path) -> None:
    """A binary glTF file with a node for every body, called like its link, that stands in its parent's."""
    path.write_bytes(_scene(still).export(file_type="glb", include_normals=True))


def write_html(still: Still, path: Path) -> None:
    """A page that needs nothing but itself: drag to turn the arm, wheel to zoom; three.js is inside, under the MIT licence."""
    from trimesh.viewer import scene_to_html

    scene, corners = _scene(still), still.surfaces().corners.reshape(-1, 3)
    view = camera(corners, AZIMUTH, ELEVATION, *RESOLUTION, field=FIELD)
    at = np.eye(4)
    at[:3, :3] = view.rotation.T * (1.0, -1.0, -1.0)  # the camera looks along its -z, y up
    at[:3, 3] = view.eye + 0.12 * (view.eye - corners.mean(axis=0))  # one step back
    scene.camera.resolution = RESOLUTION
    scene.camera.fov = tuple(np.degrees(2 * np.arctan(0.5 * np.array(RESOLUTION) / view.focal)))
    scene.camera_transform = Y_UP @ at
    square = spacing(float(np.linalg.norm(np.ptp(corners, axis=0))))
    floor = min(float(corners[:, 2].min()), 0.0)
    told = json.dumps({"title": still.arm.name, "square": square, "squares": SQUARES, "floor": floor})
    page = scene_to_html(scene).replace("trimesh: threejs viewer", html.escape(still.arm.name))
    before, _, after = page.rpartition("</body>")
    path.write_text(before + PAGE.format(told=told.replace("<", "\\u003c")) + after, encoding="utf-8", newline="\n")


def _scene(still: Still) -> Any:
    """The `trimesh.Scene`."""
    import trimesh
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    names = {body: node_name(still.arm, body) for body in (BASE, *range(len(still.arm.bodies)))}
    root = "z up"
    while root in names.values():
        root += "_"
    scene = trimesh.Scene(base_frame=root)
    scene.graph.update(frame_from=root, frame_to=names[BASE], matrix=Y_UP)
    for k, body in enumerate(still.arm.bodies):
        step = still.placements[body.parent].inverse() @ still.placements[k]
        scene.graph.update(frame_from=names[body.parent], frame_to=names[k], matrix=step.matrix())
    for body, shapes in still.shapes.items():
        for k, shape in enumerate(shapes):
            colour = [*map(linear, shape.colour), 1.0]
            material = PBRMaterial(baseColorFactor=colour, metallicFactor=0.1, roughnessFactor=0.55, doubleSided=True)
            mesh = trimesh.Trimesh(
                shape.positions,
                shape.triangles,
                vertex_normals=shape.normals,
                visual=TextureVisuals(material=material),
                process=False,
            )
            name = f"{names[body]} {k + 1}"
            scene.add_geometry(mesh, node_name=name, geom_name=name, parent_node_name=names[body])
    return scene
