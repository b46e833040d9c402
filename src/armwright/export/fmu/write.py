"""An arm, its controller or both as an FMU: sources, binaries and model description in one file."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from importlib.metadata import version as version_of
from pathlib import Path
from typing import Literal

import numpy as np

from armwright.entry import as_arm
from armwright.errors import ModelError, check_known
from armwright.export.fmu.build import PLATFORMS, build, chosen_platforms
from armwright.export.fmu.continuous import continuous_model, continuous_source
from armwright.export.fmu.description import VERSIONS, Description, build_description, model_description
from armwright.export.fmu.model import sampled_source
from armwright.export.fmu.sampled import PARTS, sampled_model
from armwright.features import Support
from armwright.kernels.c_syntax import KEYWORDS
from armwright.model import Model
from armwright.output import whole_file, working_folder
from armwright.results.result import Result
from armwright.simulation.inputs.input_schedule import all_rows
from armwright.simulation.scenario import Scenario
from armwright.simulation.scenario_parts import Loop

SUPPORT = Support(
    "export fmu",
    scenario=True,
    without_effect={"brakes": "they are released unless inputs.brake applies them"},
    refused={"lanes": "one arm"},
)

SOURCES = Path(__file__).parent / "sources"
INTERFACES = ("co-simulation", "model-exchange")
PERIOD = 1e-3  # [s] of a tick, of an arm without a scenario
DATE = (1980, 1, 1, 0, 0, 0)  # of files in the archive, so that equal FMUs have equal bytes
NOTHING_BUILT = (
    "no binaries: no C compiler here, and no zig (pip install 'armwright[fmu]'); tools that compile sources can use it"
)


@dataclass(frozen=True, eq=False)
class ExportedFmu(Result):
    """A written FMU.

    Attributes:
        path: of the file.   name: its model identifier.   version: of FMI.   interface: of `INTERFACES`.   part: of `PARTS`.
        platforms: bytes of the binary for each platform that it has one for.   size: bytes of the file.
        inputs, outputs, parameters: names of variables.   notes: for the user.
    """

    path: Path
    name: str
    version: str
    interface: str
    part: str
    platforms: Mapping[str, int]
    size: int
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    notes: tuple[str, ...] = ()


def export_fmu(
    source: Model | Scenario,
    path: str | Path,
    *,
    part: Literal["plant", "controller", "both"] = "plant",
    version: Literal["3.0", "2.0"] = "3.0",
    interface: Literal["co-simulation", "model-exchange"] = "co-simulation",
    name: str | None = None,
    platforms: Sequence[str] | None = None,
) -> ExportedFmu:
    """A simulated arm, its controller or both as an FMU, for Simulink, Modelica tools, FMPy and others. [FMI2022]

    For co-simulation it holds the simulation's own step, as C: same integrator, substeps, friction that sticks, sensors and
    delays, and gives the bits of `aw.simulate`. Time is counted in ticks; communication steps that are no multiple of one are
    refused. For model exchange it holds the plant's derivative, for the tool's own solver, with directional derivatives.

    Args:
        source: an arm, whose tick is then 1 ms, or a scenario.
        path: where the FMU is written, ending in ".fmu".
        part: "plant" (commands in, measurements out), "controller" (references and measurements in, commands out) or "both".
        version: of FMI, "3.0" or "2.0".   interface: "co-simulation" or "model-exchange".
        name: the model identifier, a C identifier; default: made from the path's name.
        platforms: that zig (the extra `fmu`) builds binaries for, such as "x86_64-linux", or "host": this computer, by its own
            compiler. Default: all six with zig, else "host". An empty list: sources alone.
    Returns:
        exported: what was written.
    Raises:
        ModelError: a name that is no C identifier, an unknown part, version, interface or platform, a compiler that fails.
        ScenarioError: a controller that cannot be traced, several lanes, a start that goes on from a state.
        OutputError: the file cannot be written.
    Example:
        >>> made = aw.export.export_fmu("two-link", "arm.fmu", platforms=["host"])
        >>> made.version
        '3.0'
    """
    path = Path(path)
    for place, value, choices in (
        ("part", part, PARTS),
        ("version", version, VERSIONS),
        ("interface", interface, INTERFACES),
    ):
        check_known(ModelError, value, choices, place=place)
    identifier = _identifier(path, name)
    targets = chosen_platforms(platforms)
    scenario = source if isinstance(source, Scenario) else Scenario(as_arm(source, "source"), loop=Loop(period=PERIOD))
    if interface == "model-exchange" and part != "plant":
        what = "a controller acts at its ticks, which a solver of other steps does not know"
        raise ModelError(what, place="part", value=part, expected="'plant', or interface = 'co-simulation'")
    with whole_file(path, (".fmu",)) as temporary:
        description, texts = _texts(scenario, part, identifier, sampled=interface == "co-simulation")
        fmi = f"fmi{version[0]}.c"
        compiled = ["model.c", "instance.c", fmi]
        texts |= {file: (SOURCES / file).read_text(encoding="ascii") for file in ("instance.h", "instance.c", fmi)}
        with working_folder(texts) as folder:
            binaries = build(folder, compiled, identifier, targets)
            files = {"modelDescription.xml": model_description(description, version, compiled).encode()}
            files |= {f"sources/{file}": text.encode() for file, text in texts.items()}
            if version == "3.0":
                files["sources/buildDescription.xml"] = build_description(identifier, compiled).encode()
            for target, binary in binaries.items():
                place_in_file = target if version == "3.0" else PLATFORMS[target].older
                files[f"binaries/{place_in_file}/{binary.name}"] = binary.read_bytes()
            sizes = {target: binary.stat().st_size for target, binary in binaries.items()}
        _archive(temporary, files)
    names = {
        kind: tuple(each.name for each in description.variables if each.causality == kind)
        for kind in ("input", "output", "parameter")
    }
    return ExportedFmu(
        path, identifier, version, interface, part, sizes, path.stat().st_size,
        names["input"], names["output"], names["parameter"],
        (*_changing(scenario, names["input"]), *(() if targets or platforms == [] else (NOTHING_BUILT,))),
    )  # fmt: skip


def _changing(scenario: Scenario, inputs: Sequence[str]) -> list[str]:
    """Sentences about inputs of the FMU that change during the scenario: its schedules are not in the FMU."""
    schedules = {name: all_rows(each) for name, each in scenario.input_schedules.items()}
    changing = [
        f"{name}.…" for name, rows in schedules.items()
        if np.any(rows != rows[0]) and any(each.startswith(f"{name}.") for each in inputs)
    ]  # fmt: skip
    if not changing:
        return []
    what = f"the scenario changes {' and '.join(changing)}: inputs of the FMU, at the scenario's first values until they are set"
    return [what, *(scenario.carried_notes if "payload.…" in changing else [])]


def _identifier(path: Path, name: str | None) -> str:
    """The model identifier.

    Raises:
        ModelError: it is no C identifier.
    """
    word = path.stem if name is None else name
    if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", word) or word in KEYWORDS or len(word) > 63:
        what = "is no C identifier, which names the FMU's binary"
        how = "letters, digits and _, not beginning with a digit; a name of its own lets the file be called as you like"
        raise ModelError(what, place="name", value=word, expected=how)
    return word


def _texts(scenario: Scenario, part: str, identifier: str, *, sampled: bool) -> tuple[Description, dict[str, str]]:
    """Description and generated texts of an FMU."""
    if sampled:
        model = sampled_model(scenario, part)
        texts, period, indicators = sampled_source(model, "@TOKEN@"), model.clock.period, ()
    else:
        model = continuous_model(scenario)
        texts, period, indicators = continuous_source(model, "@TOKEN@"), None, model.indicators
    token = _token(identifier, texts)
    stop = 1.0 if scenario.duration is None else float(scenario.duration)
    name = f"{model.arm.name} {part}"
    description = Description(
        name, identifier, token, model.about, model.variables, period, _tool(), indicators, stop
    )  # fmt: skip
    return description, {file: text.replace("@TOKEN@", token) for file, text in texts.items()}


def _token(identifier: str, texts: Mapping[str, str]) -> str:
    """The token that binds a description to its binary, from the content: equal FMUs have equal ones."""
    digest = sha256("\n".join([identifier, *texts.values()]).encode()).hexdigest()
    return "{" + "-".join([digest[:8], digest[8:12], digest[12:16], digest[16:20], digest[20:32]]) + "}"


def _tool() -> str:
    return f"Armwright {version_of('armwright')}"


def _archive(path: Path, files: Mapping[str, bytes]) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name, DATE), content, zipfile.ZIP_DEFLATED)
