"""The supply that all drives of a robot share."""

from __future__ import annotations

from pydantic import Field, model_validator

from armwright.quantity import Positive, Record


class Supply(Record):
    """A rectifier behind a source resistance, the capacitor of the bus, and a brake chopper. The bus voltage V is a state.

    C V̇ = max(0, voltage - V) / source_resistance - Σ P / V - chopper_share · V / chopper_resistance,
    P the electrical power of each drive; the rectifier takes nothing back.
    chopper_share = 0 below chopper_voltage, 1 above chopper_voltage + chopper_band, linear between.
    """

    source: str | None = None
    voltage_v: Positive = Field(description="Without load; the bus begins with it.")
    source_resistance_ohm: Positive = Field(description="Of mains, transformer and rectifier together.")
    capacitance_f: Positive = Field(description="C of the bus.")
    chopper_voltage_v: Positive | None = Field(default=None, description="At which braking begins; absent: no chopper.")
    chopper_band_v: Positive | None = Field(default=None, description="Over which the chopper goes from 0 to all.")
    chopper_resistance_ohm: Positive | None = Field(default=None, description="Of the braking resistor.")

    @model_validator(mode="after")
    def _complete(self) -> Supply:
        keys = ("chopper_voltage_v", "chopper_band_v", "chopper_resistance_ohm")
        missing = [key for key in keys if getattr(self, key) is None]
        if missing and len(missing) < len(keys):
            given = next(key for key in keys if key not in missing)
            raise ValueError(f"{given} needs {' and '.join(missing)} beside it")
        if self.chopper_voltage_v is not None and float(self.chopper_voltage_v) <= float(self.voltage_v):
            raise ValueError(
                "chopper_voltage_v: expected more than voltage_v, or the source feeds the braking resistor"
            )
        return self
