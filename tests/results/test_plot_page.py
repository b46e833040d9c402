"""Pages of runs: every number is in the page, with its unit, and nothing is asked of a network."""

import numpy as np
import pytest

import armwright as aw
from armwright.results.plot_curves import describe
from pictures.reading import Page
from simulation.runs import invented, mixed_arm


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return invented(mixed_arm(tmp_path_factory.mktemp("robot")))


def test_the_page_holds_the_description_and_every_number(run, tmp_path):
    runs = {"run": run, "lanes": invented(aw.load("two-link"), lanes=20).isel(joint=[0, 0, 1])}
    runs["lanes"] = runs["lanes"].assign_coords({name: run[name] for name in ("joint", "kind", "command")})
    aw.plot(runs, tmp_path / "run.html")
    page, plot = Page(tmp_path / "run.html"), describe(runs)
    assert page.plot["times"][0] == {"start": 0.0, "step": pytest.approx(0.05), "count": 41}
    assert [entry["name"] for entry in page.plot["legend"]] == [entry.name for entry in plot.legend]
    for drawn, panel in zip(page.plot["panels"], plot.panels, strict=True):
        assert all(drawn[name] == getattr(panel, name) for name in ("title", "symbol", "unit", "stepped"))
        for own, curve in zip(drawn["curves"], panel.curves, strict=True):
            assert all(own[name] == getattr(curve, name) for name in ("joint", "run", "series"))
            assert np.array_equal(page.values(own["values"]), curve.values.astype(np.float32))
            for places, edges in zip(own["bands"], curve.bands, strict=True):
                for place, edge in zip(places, edges, strict=True):
                    assert np.array_equal(page.values(place), edge.astype(np.float32))
    assert page.fetched() == []


def test_uneven_times_keep_their_digits(run, tmp_path):
    t = 1000.0 + np.cumsum(np.random.default_rng(1).uniform(1e-6, 1e-3, run.sizes["time"]))
    aw.plot(run.assign_coords(time=t), tmp_path / "run.html")
    page = Page(tmp_path / "run.html")
    (times,) = page.plot["times"]
    again = page.values(times["high"]).astype(float) + page.values(times["low"])
    assert np.abs(again - t).max() < 1e-11


def test_a_run_of_two_seconds_is_a_small_page(tmp_path):
    run = invented(aw.load("cmu-dd"), rows=2001)
    aw.plot(run, tmp_path / "run.html")
    assert (tmp_path / "run.html").stat().st_size < 400_000


def test_names_cannot_break_out_of_the_page(run, tmp_path):
    bad = '</script><img src=x onerror="alert(1)">'
    run = run.assign_attrs(robot=bad).assign_coords(joint=[bad, "$title", "b"])
    aw.plot({bad: run, "other": run}, tmp_path / "run.html")
    page = Page(tmp_path / "run.html")
    assert "<img" not in page.text
    assert [entry["name"] for entry in page.plot["legend"]] == [bad, "$title", "b", bad, "other"]
