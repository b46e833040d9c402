"""The model description of an FMU, `modelDescription.xml`, in FMI 3.0 and 2.0. [FMI2022]"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

from armwright.export.fmu.variables import FmuVariable, base_unit

VERSIONS = ("3.0", "2.0")
INDEPENDENT = FmuVariable("time", "independent", "continuous", "s", "simulation time", "", 0)


@dataclass(frozen=True)
class Description:
    """Contents of a model description.

    Attributes:
        name: of the model.   identifier: of its files, a C identifier.   token: of this FMU.   about: one line.
        variables: all but time; a variable's value reference is its place, from 1 on.
        period: [s] of a tick; None: the FMU is for model exchange.   tool: name and version of what made it.
        indicators: variables that are event indicators, of model exchange, by name.
        stop: [s] that a simulation takes by default.
    """

    name: str
    identifier: str
    token: str
    about: str
    variables: tuple[FmuVariable, ...]
    period: float | None
    tool: str
    indicators: tuple[str, ...] = ()
    stop: float = 1.0


def model_description(it: Description, version: str, sources: Sequence[str]) -> str:
    """The text of modelDescription.xml.

    Args:
        it: what it says.   version: of `VERSIONS`.   sources: C files in the order in which they are compiled.
    """
    lines = (_version_2 if version == "2.0" else _version_3)(it, sources)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + "\n".join(lines) + "\n"


def _tag(element: str, end: str = "/", /, **attributes: object) -> str:
    words = [f"{key}={quoteattr(_text(value))}" for key, value in attributes.items() if value is not None]
    return f"<{' '.join([element, *words])}{end}>"


def _text(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value).replace("nan", "NaN").replace("inf", "INF")  # as XML Schema writes them
    return str(value)


def _head(it: Description, version: str, key: str, **further: object) -> str:
    return _tag(
        "fmiModelDescription", "", fmiVersion=version, modelName=it.name, **{key: it.token}, description=it.about,
        generationTool=it.tool, variableNamingConvention="structured", **further,
    )  # fmt: skip


def _units(it: Description) -> list[str]:
    """Definitions of the units that occur."""
    lines = ["<UnitDefinitions>"]
    for unit in dict.fromkeys(["s", *(each.unit for each in it.variables)]):
        base = base_unit(unit)
        if unit == "-":
            continue
        offset = 273.15 if unit == "°C" else None
        inner = [] if base is None else [_tag("BaseUnit", **base, **({} if offset is None else {"offset": offset}))]
        lines += [_tag("Unit", "", name=unit), *inner, "</Unit>"] if inner else [_tag("Unit", name=unit)]
    return [*lines, "</UnitDefinitions>"]


def _experiment(it: Description) -> str:
    return _tag("DefaultExperiment", startTime=0.0, stopTime=it.stop, stepSize=it.period)


def _unit(each: FmuVariable) -> str | None:
    return None if each.unit == "-" else each.unit


def _start(each: FmuVariable) -> float | None:
    return each.start if each.causality in ("input", "parameter") else None


def _initial(each: FmuVariable) -> str | None:
    if each.causality in ("input", "independent"):
        return None
    return "exact" if each.causality == "parameter" else "calculated"


def _unknowns(it: Description) -> tuple[list[int], list[int], list[int]]:
    """Value references of outputs, of state derivatives, and of both, which are computed at the beginning."""
    numbered = list(enumerate(it.variables, 1))
    outputs = [k for k, each in numbered if each.causality == "output"]
    derivatives = [k for k, each in numbered if each.derivative_of is not None]
    return outputs, derivatives, sorted({*outputs, *derivatives})


def _version_3(it: Description, sources: Sequence[str]) -> list[str]:
    places = {each.name: k for k, each in enumerate(it.variables, 1)}
    flags = {"modelIdentifier": it.identifier, "canGetAndSetFMUState": True, "canSerializeFMUState": True}
    if it.period is None:
        kind = _tag("ModelExchange", **flags, providesDirectionalDerivatives=True, needsCompletedIntegratorStep=False)
    else:
        kind = _tag(
            "CoSimulation", **flags, canHandleVariableCommunicationStepSize=True, fixedInternalStepSize=it.period
        )
    rows = [_tag("Float64", name="time", valueReference=0, causality="independent", variability="continuous", unit="s",
                 description=INDEPENDENT.about)]  # fmt: skip
    rows += [
        _tag(
            "Float64", name=each.name, valueReference=k, causality=each.causality, variability=each.variability,
            initial=_initial(each), unit=_unit(each), description=each.about, start=_start(each),
            derivative=places.get(each.derivative_of or ""),
        )
        for k, each in enumerate(it.variables, 1)
    ]  # fmt: skip
    outputs, derivatives, computed = _unknowns(it)
    structure = [
        *(_tag("Output", valueReference=k) for k in outputs),
        *(_tag("ContinuousStateDerivative", valueReference=k) for k in derivatives),
        *(_tag("InitialUnknown", valueReference=k) for k in computed),
        *(_tag("EventIndicator", valueReference=places[name]) for name in it.indicators),
    ]
    return [
        _head(it, "3.0", "instantiationToken"), kind, *_units(it), _experiment(it),
        "<ModelVariables>", *rows, "</ModelVariables>",
        "<ModelStructure>", *structure, "</ModelStructure>", "</fmiModelDescription>",
    ]  # fmt: skip


def _version_2(it: Description, sources: Sequence[str]) -> list[str]:
    places = {each.name: k for k, each in enumerate(it.variables, 2)}  # here variables count from 1, time first
    flags = {"modelIdentifier": it.identifier, "canGetAndSetFMUstate": True, "canSerializeFMUstate": True}
    flags |= {"canNotUseMemoryManagementFunctions": True}
    if it.period is None:
        name, more = "ModelExchange", {"providesDirectionalDerivative": True, "completedIntegratorStepNotNeeded": True}
    else:
        name, more = "CoSimulation", {"canHandleVariableCommunicationStepSize": True}
    kind = [_tag(name, "", **flags, **more), "<SourceFiles>", *(_tag("File", name=file) for file in sources)]
    kind += ["</SourceFiles>", f"</{name}>"]
    rows = [
        _tag("ScalarVariable", "", name="time", valueReference=0, causality="independent", variability="continuous"),
        _tag("Real", unit="s"), "</ScalarVariable>",
    ]  # fmt: skip
    for k, each in enumerate(it.variables, 1):
        words = {"name": each.name, "valueReference": k, "causality": each.causality, "variability": each.variability}
        rows += [
            _tag("ScalarVariable", "", **words, initial=_initial(each), description=each.about),
            _tag("Real", unit=_unit(each), start=_start(each), derivative=places.get(each.derivative_of or "")),
            "</ScalarVariable>",
        ]
    structure = []
    outputs, derivatives, computed = _unknowns(it)
    groups = {"Outputs": outputs, "Derivatives": derivatives, "InitialUnknowns": computed}
    for group, members in groups.items():
        if members:
            structure += [f"<{group}>", *(_tag("Unknown", index=k + 1) for k in members), f"</{group}>"]
    indicators = {} if it.period is not None else {"numberOfEventIndicators": len(it.indicators)}
    return [
        _head(it, "2.0", "guid", **indicators), *kind, *_units(it), _experiment(it),
        "<ModelVariables>", *rows, "</ModelVariables>",
        "<ModelStructure>", *structure, "</ModelStructure>", "</fmiModelDescription>",
    ]  # fmt: skip


def build_description(identifier: str, sources: Sequence[str]) -> str:
    """The text of sources/buildDescription.xml of FMI 3.0: how the sources are compiled."""
    files = [_tag("SourceFile", name=file) for file in sources]
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<fmiBuildDescription fmiVersion="3.0">',
        _tag("BuildConfiguration", "", modelIdentifier=identifier),
        _tag("SourceFileSet", "", language="C99", compilerOptions="-O2 -ffp-contract=off"),
        *files,
        "</SourceFileSet>",
        _tag("Library", name="m", external=True),
        "</BuildConfiguration>",
        "</fmiBuildDescription>",
    ]
    return "\n".join(lines) + "\n"
