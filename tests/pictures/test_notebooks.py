"""In a notebook arms, scenarios and plots show themselves, and long work a bar; the example notebooks run."""

from pathlib import Path

import pytest

import armwright as aw
from armwright.description.database import parse
from armwright.model import build_model
from physics.arms import NAMES, arm, workshop

nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")
NOTEBOOKS = sorted((Path(__file__).parents[2] / "examples").glob("*.ipynb"))


def executed(notebook, folder):
    """The notebook with its outputs."""
    nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(folder)}}).execute()
    return notebook


def kinds(notebook):
    """MIME types of all outputs, in order."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    return [kind for output in outputs for kind in output.get("data", {"stream": None})]


@pytest.mark.study
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_an_example_notebook_runs_and_has_no_outputs_stored(path, tmp_path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in notebook.cells)
    seen = kinds(executed(notebook, tmp_path))
    assert "text/html" in seen
    assert "image/png" in seen


@pytest.mark.study
def test_bars_in_a_notebook(tmp_path):
    begin = "import armwright as aw, armwright.progress\narmwright.progress.PATIENCE = 0.0\narmwright.progress.OFTEN = 0.0\n"
    begin += (
        "long = aw.Scenario(aw.load('two-link'), command=[0.1, 0.0], duration=100.0, solver=aw.Solver(step=1e-3),"
        " recording=aw.Recording(1000))\nrun = aw.simulate(long, progress=False)"
    )
    cells = [begin, "aw.simulate(long); None"]
    notebook = executed(nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(text) for text in cells]), tmp_path)
    silent, shown = ([output["output_type"] for output in cell.outputs] for cell in notebook.cells)
    assert silent == []
    assert shown == ["display_data"]


@pytest.mark.sample(1)
@pytest.mark.parametrize("name", NAMES)
def test_every_arm_has_a_page_without_scripts(name):
    page = arm(name)._repr_html_()
    assert "data:image/png;base64," in page
    assert "<script" not in page
    assert all(f"<td>{joint}</td>" in page for joint in arm(name).names)


def test_compiled_arms_scenarios_and_hostile_names():
    data = workshop()
    data["name"] = "<script>alert(1)</script>"
    page = aw.compile(build_model(parse(data, "x")))._repr_html_()
    assert "<script" not in page
    loop = aw.Loop(aw.JointPID(kp=[1.0, 1.0], kd=[1.0, 1.0], ki=0.0), [0.0, 0.0], 2e-3)
    page = aw.Scenario(arm("two-link"), loop=loop, duration=1.5, start=[0.1, 0.2])._repr_html_()
    assert "JointPID, every 2 ms" in page
    assert "1.5 s" in page
    drawn = aw.Scenario(arm("two-link"), command=aw.Batch([[0.0, 0.0], [1.0, 0.0]]), duration=1.0)._repr_html_()
    assert "<td>lanes</td><td>2</td>" in drawn
