"""FMUs in the hands of FMPy, another's implementation of the standard."""

from __future__ import annotations

import shutil
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Model, FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Model, FMU3Slave
from fmpy.validation import validate_fmu

from armwright.export.controller.sil import find_compiler
from armwright.export.fmu.build import HOST, has_zig


def this_platform() -> list[str]:
    """The platforms to build for where a test runs an FMU; skips the test where nothing compiles for it."""
    if find_compiler() is None and not has_zig():
        pytest.skip("no C compiler here, and no zig")
    return [HOST]


class Instance:
    """An FMU that was loaded: variables by name, mode by mode."""

    def __init__(self, path: Path, *, exchange: bool = False, token: str | None = None):
        self.path = Path(path)
        assert validate_fmu(str(path)) == []
        self.description = read_model_description(str(path))
        self.folder = extract(str(path))
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.is_3 = self.description.fmiVersion == "3.0"
        kind = (FMU3Model if exchange else FMU3Slave) if self.is_3 else (FMU2Model if exchange else FMU2Slave)
        part = self.description.modelExchange if exchange else self.description.coSimulation
        self.fmu = kind(
            guid=token or self.description.guid,
            unzipDirectory=self.folder,
            modelIdentifier=part.modelIdentifier,
            instanceName="one",
        )
        self.messages: list[str] = []
        if self.is_3:
            self.fmu.instantiate(logMessage=lambda e, status, category, message: self.messages.append(message.decode()))
        else:
            self.fmu.instantiate(callbacks=self._callbacks())

    def _callbacks(self):
        def log(environment, name, status, category, message):
            self.messages.append(message.decode())

        self._kept = fmi2CallbackFunctions()
        self._kept.logger = fmi2CallbackLoggerTYPE(log)
        return self._kept

    def set(self, name, value):
        setter = self.fmu.setFloat64 if self.is_3 else self.fmu.setReal
        setter([self.references[name]], [float(value)])

    def get(self, *names):
        getter = self.fmu.getFloat64 if self.is_3 else self.fmu.getReal
        return np.array(getter([self.references[name] for name in names]))

    def names(self, prefix, causality):
        """Names of the variables of a signal, in their order."""
        return [
            v.name
            for v in self.description.modelVariables
            if v.causality == causality and v.name.startswith(f"{prefix}.")
        ]

    def begin(self, start=0.0, **values):
        if not self.is_3:
            self.fmu.setupExperiment(startTime=start)
            self.fmu.enterInitializationMode()
        else:
            self.fmu.enterInitializationMode(startTime=start)
        for name, value in values.items():
            self.set(name, value)
        self.fmu.exitInitializationMode()

    def step(self, time, size):
        self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=size)

    def directional(self, unknowns, knowns, seed):
        """Derivatives of unknowns along a direction of knowns."""
        given = [[self.references[name] for name in names] for names in (unknowns, knowns)]
        call = self.fmu.getDirectionalDerivative
        return np.array(call(*given, list(seed)))

    def keep(self):
        """A copy of the state."""
        return self.fmu.getFMUState()

    def restore(self, state):
        self.fmu.setFMUState(state)

    def release(self, state):
        (self.fmu.freeFMUState if self.is_3 else self.fmu.freeFMUstate)(state)

    def serialise(self, state):
        return (self.fmu.serializeFMUState if self.is_3 else self.fmu.serializeFMUstate)(state)

    def deserialise(self, data):
        return (self.fmu.deserializeFMUState if self.is_3 else self.fmu.deSerializeFMUstate)(data)

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)


def simulated(path, duration, tolerance=1e-9, **inputs):
    """States at the end of a run by FMPy's CVode, inputs constant: values by prefix of their names."""
    assert validate_fmu(str(path)) == []
    names = [v.name for v in read_model_description(str(path)).modelVariables]
    values = {
        name: float(value)
        for prefix, row in inputs.items()
        for name, value in zip([n for n in names if n.startswith(f"{prefix}.")], row, strict=True)
    }
    result = fmpy.simulate_fmu(
        str(path),
        stop_time=duration,
        output_interval=duration / 10.0,
        relative_tolerance=tolerance,
        solver="CVode",
        start_values=values,
        output=[n for n in names if n.startswith("x.")],
        fmi_type="ModelExchange",
    )
    return np.array(list(result[-1])[1:])
