"""Physically possible parameters of a real arm predict its torques as well as unconstrained ones do."""

from __future__ import annotations

import numpy as np
import pytest

import armwright as aw
from armwright.identification.arm.base import base_parameters
from armwright.identification.arm.equations import equations_of, stacked
from armwright.identification.arm.fit import fit_arm, measures_of
from armwright.identification.arm.physical import (
    PER_LINK,
    PhysicalBounds,
    physical_by_sdp,
    pseudo_inertias,
)
from armwright.identification.arm.samples import stream_of
from armwright.identification.arm.torque_model import torque_model
from identification.arm.tx40 import tx40_urdf
from identification.real_logs import TX40, log_of


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tx40")
    log = aw.identification.read_log(log_of(folder, "staubli_tx40", TX40))
    model = torque_model(aw.load(tx40_urdf(folder), kinematics_only=True), gears=log.gears)
    preparation = aw.identification.choose_preparation(log, cutoff=100.0, decimate=20)
    equations = equations_of(stream_of(log, model.arm, None, preparation).samples(model), model)
    return model, equations, fit_arm(equations, base_parameters(model))


@pytest.mark.study
def test_tx40(problem):
    pytest.importorskip("cvxpy", reason="the extra `identify` is not installed")
    model, equations, fit = problem
    matrix, _ = stacked(equations.factors, len(model), fit.weights)
    links = np.arange(PER_LINK * 6).reshape(-1, PER_LINK)
    drives = [
        k for k, c in enumerate(model.columns) if c.kind in ("rotor", "viscous", "coulomb") and len(c.turned) == 1
    ]
    estimate = physical_by_sdp(matrix[:, :-1], matrix[:, -1], PhysicalBounds(model.names, links, drives))
    r2 = measures_of(equations.factors, estimate.values)[2]
    assert (fit.r2 - r2 < 0.003).all()
    assert (np.linalg.eigvalsh(pseudo_inertias(estimate.values[links])) >= 0).all()
    assert (estimate.values[drives] >= 0).all()
    assert estimate.cost >= estimate.cost_free
    for k in drives:  # what stands at its bound is said
        if estimate.values[k] < 1e-9:
            assert estimate.at_bound[k]
