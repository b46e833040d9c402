"""FMUs in the hands of FMPy, another's implementation of the standard."""

from __future__ import annotations

import shutil
from pathlib import Path

import fmpy
import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Model, FMU2Slave
from fmpy.fmi3 import FMU3Model, FMU3Slave
from fmpy.validation import validate_fmu


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
        from fmpy.fmi2 import fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

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

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)


__all__ = ["Instance", "fmpy", "validate_fmu"]
