"""The controller of a scenario as a folder of C99, compared with the simulation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from armwright.entry import AnyScenario, as_scenario
from armwright.errors import ModelError, check_known
from armwright.export.c import files_to_write
from armwright.export.c_header import export_name
from armwright.export.controller.build_files import cmake, readme
from armwright.export.controller.footprint import Footprint, footprint
from armwright.export.controller.header import header
from armwright.export.controller.parameters import parameter_file
from armwright.export.controller.recording import ControllerRecording, record
from armwright.export.controller.selftest import selftest
from armwright.export.controller.sil import SoftwareInTheLoop, find_compiler, software_in_the_loop
from armwright.export.controller.source import source
from armwright.export.controller.stages import ControllerStages
from armwright.features import Support
from armwright.kernels.c import REALS
from armwright.kernels.compiled import KERNELS
from armwright.output import working_folder
from armwright.results.result import Result
from armwright.simulation.checks import is_whole

OF_THE_BUS = "it belongs to the sensors, the bus and the arm"
SUPPORT = Support(
    "export controller",
    scenario=True,
    approximated={name: f"where the controller computes dynamics, {how}" for name, how in KERNELS.approximated.items()},
    without_effect={
        "brakes": OF_THE_BUS,
        **dict.fromkeys(
            ("pose", "schedule of poses", "motion", "grips of a motion"), "the reference is an input of each step"
        ),
        **dict.fromkeys(
            (
                *("delays", "jitter", "lost samples", "clock drift", "encoder counts", "sensor noise", "speed filter"),
                *("wrench", "applied brakes", "payloads over time", "moving start"),
                *("servo counts", "supply over time", "servos off"),
            ),
            OF_THE_BUS,
        ),
    },
    refused={"commands over time": "no controller", "lanes": "one arm"},
)

COMPARED = 100_000  # ticks that are compared behind an export, at most
WRITTEN = 256  # of them in the self-test
NO_COMPILER = "no C compiler here (gcc, clang, cc): compile and run the self-test where there is one"


@dataclass(frozen=True, eq=False)
class ExportedController(Result):
    """The C files of a controller.

    Attributes:
        name: that everything in it begins with.
        paths: header, C file, self-test, CMakeLists.txt, README.md, NAME.parameters.
        comparison: with the simulation, of the code as this computer's compiler makes it; None where there is no compiler.
        notes: for the user.   footprint: its memory, where a limit was given.
    """

    name: str
    paths: tuple[Path, ...]
    comparison: SoftwareInTheLoop | None
    notes: tuple[str, ...] = ()
    footprint: Footprint | None = None


def export_controller(
    scenario: AnyScenario,
    directory: str | Path,
    *,
    name: str | None = None,
    gains: Sequence[str] = (),
    ticks: int | None = None,
    real: Literal["double", "float"] = "double",
    counts: bool = False,
    ram: int | None = None,
    flash: int | None = None,
) -> ExportedController:
    """The controller of a scenario's loop as C99, compared with the simulation bit by bit if a compiler is available.

    Written are `NAME.h`, `NAME.c`, a self-test with recorded inputs, `CMakeLists.txt`, `README.md` and `NAME.parameters`, the
    numbers of the scenario with a checksum, which the code can load: all of them or none. The
    code is the programs that the simulation is compiled from: controller, rate limit, limit and resolution of the command,
    and the rule that a lost sample repeats the last one. It allocates nothing and does not recurse.

    Args:
        scenario: with a loop whose controller can be traced, and without lanes.
        directory: created if it does not exist; files of those names in it are replaced.
        name: what names in C begin with; default: the arm's name and "controller".
        gains: fields of the controller, or of one inside it (`inner.kp`, or `kp` where no outer one has it), that become members
            of the struct of parameters; the simulation is then the one of a `Batch` of one value, whose bits may differ from
            those of the constant.
        ticks: of the scenario that are compared; default: all, at most 100,000.
        real: "double" or "float". In float the commands are near to those of the simulation, by the `error` of the comparison,
            and the self-test expects the bits that this computer's compiler gives.
        counts: true: positions are measured in counts of the scenario's encoders, as whole numbers.
        ram: bytes that the target has for it; needs a compiler, `arm-none-eabi-gcc` or this computer's.   flash: the same.
    Returns:
        exported: the files, and how the code compares with the simulation.
    Raises:
        ScenarioError: no controller, several lanes, a controller that cannot be traced: names the line and why.
        OutputError: the directory or a file cannot be written.
        ModelError: a controller that takes more RAM or flash than there is. The compiler ends with an error, or the compiled
            code gives other commands than the simulation; nothing is then written. Float without a compiler. A name of more
            than 200 characters.
    Example:
        >>> pid = aw.JointPID(kp=[900.0, 250.0], kd=[180.0, 50.0], limit=[150, 40])
        >>> loop = aw.Loop(pid, aw.trajectories.Step([0.0, 0.0], [0.5, -0.5]), period=0.002)
        >>> scenario = aw.Scenario("two-link", 0.1, loop=loop)
        >>> made = aw.export.export_controller(scenario, "c", name="hold")
        >>> [path.name for path in made.paths][:3]
        ['hold.h', 'hold.c', 'hold_selftest.c']
    """
    scenario = as_scenario(scenario)
    check_known(ModelError, real, REALS, place="real")
    if real == "float" and find_compiler() is None:
        raise ModelError("needs a C compiler to say what it costs", place="real", value=real, expected="'double'")
    for place, value in (("ticks", ticks), ("ram", ram), ("flash", flash)):
        if value is not None and not is_whole(value, 1):
            raise ModelError(place=place, value=value, expected="a whole number of 1 or more")
    fields = (gains,) if isinstance(gains, str) else tuple(gains)
    stages = ControllerStages.of(scenario, name, fields, counts=counts)
    recording = record(stages, ticks or min(scenario.ticks, COMPARED))
    code = controller_code(stages, real)
    taken = None if ram is None and flash is None else footprint(stages.name, code)
    if taken is not None:
        taken.check(ram, flash)
    tested, comparison = with_selftest(stages, recording, code, real)
    texts: dict[str, str | bytes] = tested | {
        "CMakeLists.txt": cmake(stages.name),
        "README.md": readme(stages, min(recording.ticks, WRITTEN), real),
        f"{stages.name}.parameters": parameter_file(stages, real),
    }
    folder = Path(directory)
    with files_to_write(folder, texts):
        pass
    notes = list(SUPPORT.notes(scenario.arm))
    last = stages.ticks_of_time(real)
    if real == "float" and last is not None:
        what = "the controller reads the time t, which single precision has to within 1 µs for"
        notes.append(f"{what} {last * stages.period:.4g} s behind `init`: from then on `step` sets the status bit TIME")
    if comparison is None:
        notes.append(NO_COMPILER)
    return ExportedController(stages.name, tuple(folder / file for file in texts), comparison, tuple(notes), taken)


def controller_code(stages: ControllerStages, real: str = "double") -> dict[str, str]:
    """Header and C file of a controller, by name.

    Raises:
        ModelError: a name that is too long for a file.
    """
    name = export_name(stages.name)
    return {f"{name}.h": header(stages, real), f"{name}.c": source(stages, real)}


def with_selftest(
    stages: ControllerStages, recording: ControllerRecording, code: Mapping[str, str], real: str = "double"
) -> tuple[dict[str, str], SoftwareInTheLoop | None]:
    """Header and C file with their self-test, and their comparison with the simulation; None without a compiler.

    Raises:
        ModelError: in double, a command with other bits.
    """
    comparison = _compared(stages, recording, code, real) if find_compiler() is not None else None
    short = recording.first(WRITTEN)
    expected = short.u if comparison is None else comparison.commands[:WRITTEN]
    return {**code, f"{stages.name}_selftest.c": selftest(stages, short, expected, real)}, comparison


def _compared(
    stages: ControllerStages, recording: ControllerRecording, code: Mapping[str, str], real: str
) -> SoftwareInTheLoop:
    """Comparison of header and C file with the simulation.

    Raises:
        ModelError: in double, a command with other bits.
    """
    with working_folder(code) as place:
        comparison = software_in_the_loop(stages, recording, place, real)
    if real == "double" and comparison.first is not None:
        what = f"{comparison.others} of {comparison.ticks} commands have other bits than the simulation's, the first in tick"
        raise ModelError(
            f"{what} {comparison.first}", place=stages.name, expected="equal bits; an fma() that rounds once"
        )
    return comparison
