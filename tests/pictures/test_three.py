"""The animated glTF in three.js, a reader that nobody here wrote, in a real browser: its hand is where it should be."""

import base64
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

import armwright as aw
from armwright.pictures.posed_arm import upright
from pictures.browser import Browser, needs_browser

pytestmark = needs_browser
PAGE = """<!DOCTYPE html><html><body style="margin:0"><script>%s</script><script>
const renderer = new THREE.WebGLRenderer({antialias: true, preserveDrawingBuffer: true});
renderer.setSize(600, 500); document.body.appendChild(renderer.domElement);
const scene = new THREE.Scene(); scene.background = new THREE.Color(0xffffff);
scene.add(new THREE.HemisphereLight(0xffffff, 0x444444, 1.5));
const camera = new THREE.PerspectiveCamera(40, 1.2, 0.01, 100);
let mixer, loaded, action;
new THREE.GLTFLoader().load("data:application/octet-stream;base64,%s", gltf => {
    loaded = gltf; scene.add(gltf.scene);
    const box = new THREE.Box3().setFromObject(gltf.scene), middle = box.getCenter(new THREE.Vector3());
    const far = 2.0 * box.getSize(new THREE.Vector3()).length();
    camera.position.set(middle.x + far, middle.y + 0.5 * far, middle.z + far);
    camera.lookAt(middle);
    mixer = new THREE.AnimationMixer(gltf.scene);
    action = mixer.clipAction(gltf.animations[0]);
    action.setLoop(THREE.LoopOnce); action.clampWhenFinished = true; action.play();
    document.title = "ready";
});
function at(t) {
    action.reset(); mixer.setTime(t); scene.updateMatrixWorld(true); renderer.render(scene, camera);
    let tip = null; scene.traverse(node => { if (node.name.startsWith("tip")) tip = node; });
    return new THREE.Vector3().setFromMatrixPosition(tip.matrixWorld).toArray();
}
</script></body></html>"""


def library() -> str:
    """three.js and its reader of glTF, as they come with trimesh; what follows them is trimesh's own page."""
    with zipfile.ZipFile(Path(trimesh.__file__).parent / "resources" / "templates" / "viewer.zip") as file:
        text = file.read("viewer.html.template").decode("utf-8")
    return text[text.index("<script>") + len("<script>") : text.index("var camera,controls,scene,renderer")]


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """A run, and a browser that shows it."""
    folder = tmp_path_factory.mktemp("three")
    arm = aw.load("cmu-dd")
    run = aw.simulate(aw.Scenario(arm, command=[8, 12, 8, 4, 2, 1], duration=1.0, solver=aw.Solver(step=1e-3)))
    aw.animate(run, arm, folder / "run.glb")
    data = base64.b64encode((folder / "run.glb").read_bytes()).decode()
    (folder / "page.html").write_text(
        PAGE.replace("%s", "\0", 2).replace("\0", library(), 1).replace("\0", data, 1), "utf-8"
    )
    browser = Browser(folder)
    browser.open(folder / "page.html", size=(620, 520), stands="document.title == 'ready'")
    yield arm, run, browser
    browser.close()


@pytest.mark.study
def test_it_has_a_track_for_every_joint(played):
    arm, _, browser = played
    assert browser.faults() == []
    assert browser.value("loaded.animations[0].tracks.length") == arm.n
    assert browser.value("loaded.animations[0].duration") == pytest.approx(1.0, abs=1e-6)


@pytest.mark.sample(1)
@pytest.mark.parametrize("t", [0.0, 0.25, 0.7, 1.0])
def test_the_hand_is_where_forward_kinematics_says(played, t):
    arm, run, browser = played
    x, y, z = browser.value(f"at({t})")
    q = run["q"].sel(time=t, method="nearest").values
    expected = aw.forward_kinematics(arm, q)[:3, 3]
    np.testing.assert_allclose([x, -z, y], upright(arm) @ expected, atol=1e-5)  # glTF's y is up


def test_it_is_drawn_and_moves(played):
    _, _, browser = played
    pictures = []
    for t in (0.0, 1.0):
        browser.value(f"at({t})")
        pictures.append(browser.picture())
    first, last = pictures
    assert (first.max(axis=2) < 230).mean() > 0.01
    assert (np.abs(first - last).max(axis=2) > 30).mean() > 0.002
