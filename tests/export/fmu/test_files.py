"""Files of an FMU: binaries of other systems, sources that compile elsewhere, units; refusals, and the command."""

import json
import shutil
import struct
import subprocess
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from fmpy import read_model_description
from typer.testing import CliRunner

import armwright as aw
from armwright.cli.app import app
from armwright.errors import ArmwrightError, ModelError, ScenarioError
from armwright.export.fmu import build
from armwright.export.fmu.variables import base_unit, quoted
from export.controllers import EXAMPLES
from export.fmu.fmus import Instance, this_platform, validate_fmu
from raises_at import raises_at
from simulation.plants import COULOMB, MANY, MOTOR, pendulum

PLAIN = aw.Scenario(MANY["plain"], loop=aw.Loop(period=1e-3))
MACHINES = {  # of a binary's head: magic, its offset, and the processor's number at another
    "x86_64-linux": (b"\x7fELF", "<H", 18, 62),
    "aarch64-linux": (b"\x7fELF", "<H", 18, 183),
    "x86_64-windows": (b"MZ", "<H", None, 0x8664),
    "aarch64-darwin": (b"\xcf\xfa\xed\xfe", "<I", 4, 0x0100000C),
}
EXPECTED = ("-Wno-unused-function", "-Wno-unused-parameter")  # functions of the standard that read nothing


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.study
def test_zig_builds_for_any_system(name, tmp_path):
    """Also for this computer: then with the bits that its own compiler gives."""
    pytest.importorskip("ziglang", reason="needs the extra fmu")
    path = tmp_path / "plant.fmu"
    exported = aw.export.export_fmu(PLAIN, path, platforms=[name])
    assert list(exported.platforms) == [name]
    magic, form, place, machine = MACHINES[name]
    with zipfile.ZipFile(path) as archive:
        data = archive.read(f"binaries/{name}/plant{build.PLATFORMS[name].ending}")
    assert data.startswith(magic)
    place = struct.unpack_from("<I", data, 0x3C)[0] + 4 if place is None else place
    assert struct.unpack_from(form, data, place) == (machine,)
    assert b"fmi3DoStep" in data
    if name != build.host_platform():
        return
    rows = []
    for platform in (name, *this_platform()):
        fmu = Instance(aw.export.export_fmu(PLAIN, path, platforms=[platform]).path)
        fmu.begin()
        fmu.set("u.joint0", 5.0)
        fmu.step(0.0, 0.2)
        rows.append(fmu.get("x.q.joint0", "x.qd.joint0"))
        fmu.close()
    np.testing.assert_array_equal(*rows)


@pytest.mark.parametrize("interface", ["co-simulation", "model-exchange"])
@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_sources_compile_without_a_warning(interface, version, tmp_path):
    """As strict C99 by GCC and Clang; FMI's version is the tool's that compiles them."""
    path = tmp_path / "plant.fmu"
    exported = aw.export.export_fmu(PLAIN, path, interface=interface, version=version, platforms=[])
    assert not exported.platforms
    assert validate_fmu(str(path)) == []
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    sources = sorted(str(each) for each in (tmp_path / "sources").glob("*.c"))
    compilers = [compiler for compiler in ("gcc", "clang") if shutil.which(compiler)]
    if not compilers:
        pytest.skip("neither GCC nor Clang here")
    for compiler in compilers:
        flags = [
            "-std=c99",
            "-O1",
            "-Wall",
            "-Wextra",
            "-Wconversion",
            "-Wshadow",
            "-pedantic",
            "-Werror",
            "-fsyntax-only",
        ]
        done = subprocess.run([compiler, *flags, *EXPECTED, *sources], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


USE = """\
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
void *fmi3InstantiateCoSimulation(const char *, const char *, const char *, bool, bool, bool, bool, const uint32_t *, size_t,
    void *, void (*)(void *, int, const char *, const char *), const void *);
int fmi3EnterInitializationMode(void *, bool, double, double, bool, double), fmi3ExitInitializationMode(void *);
int fmi3DoStep(void *, double, double, bool, bool *, bool *, bool *, double *);
int fmi3GetFMUState(void *, void **), fmi3SetFMUState(void *, void *), fmi3FreeFMUState(void *, void **);
int fmi3SerializedFMUStateSize(void *, void *, size_t *), fmi3SerializeFMUState(void *, void *, uint8_t *, size_t);
int fmi3DeserializeFMUState(void *, const uint8_t *, size_t, void **);
int fmi3GetFloat64(void *, const uint32_t *, size_t, double *, size_t), fmi3Reset(void *);
void fmi3FreeInstance(void *);
static void told(void *e, int s, const char *c, const char *m) { (void)e, (void)s, (void)c; puts(m); }
int main(void)
{
    void *i = fmi3InstantiateCoSimulation("one", "TOKEN", "", 0, 0, 0, 0, NULL, 0, NULL, told, NULL), *state = NULL;
    bool a, b, c;
    double last, values[NUMBER];
    uint32_t references[NUMBER], k;
    size_t size;
    uint8_t *bytes;
    int wrong = 0;
    for (k = 0; k < NUMBER; k++) references[k] = k;
    wrong |= fmi3EnterInitializationMode(i, 0, 0, 0, 0, 0) | fmi3ExitInitializationMode(i) | fmi3GetFMUState(i, &state);
    for (k = 0; k < 50; k++) wrong |= fmi3DoStep(i, k * 1e-3, 1e-3, 0, &a, &b, &c, &last);
    wrong |= fmi3GetFloat64(i, references, NUMBER, values, NUMBER) | fmi3SerializedFMUStateSize(i, state, &size);
    bytes = malloc(size);
    wrong |= fmi3SerializeFMUState(i, state, bytes, size) | fmi3FreeFMUState(i, &state);
    wrong |= fmi3DeserializeFMUState(i, bytes, size, &state) | fmi3SetFMUState(i, state) | fmi3FreeFMUState(i, &state);
    wrong |= fmi3DoStep(i, 0.0, 1e-3, 0, &a, &b, &c, &last) | fmi3Reset(i);
    free(bytes);
    fmi3FreeInstance(i);
    return wrong;
}
"""


@pytest.mark.study
@pytest.mark.skipif(shutil.which("gcc") is None, reason="no GCC here")
def test_no_address_is_wrong_and_no_behaviour_undefined(tmp_path):
    """An arm with every effect, noise and delays, under the sanitizers of the compiler, leaks included."""
    loop = aw.Loop(
        period=1e-3, sensors=aw.Sensors(counts=4096, position_noise=1e-4), timing=aw.Timing("one-tick", jitter=4e-4)
    )
    path = aw.export.export_fmu(aw.Scenario(MANY["all"], loop=loop), tmp_path / "plant.fmu", platforms=[]).path
    description = read_model_description(str(path))
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    text = USE.replace("TOKEN", description.guid).replace("NUMBER", str(len(description.modelVariables)))
    (tmp_path / "use.c").write_text(text)
    sources = [str(each) for each in (tmp_path / "use.c", *sorted((tmp_path / "sources").glob("*.c")))]
    flags = ["-std=c99", "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    built = subprocess.run(
        ["gcc", *flags, *sources, "-o", str(tmp_path / "use"), "-lm"], capture_output=True, text=True
    )
    if "sanitize" in built.stderr or "libasan" in built.stderr:
        pytest.skip("this compiler has no sanitizers")
    assert built.returncode == 0, built.stderr
    done = subprocess.run([str(tmp_path / "use")], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_variables_have_the_units_and_words_of_their_signals(tmp_path):
    path = aw.export.export_fmu(aw.load("puma560"), tmp_path / "puma560.fmu", platforms=[]).path
    description = read_model_description(str(path))
    found = {each.name: each for each in description.modelVariables}
    name = aw.load("puma560").names[1]
    assert (found[f"u.{name}"].unit, found[f"u.{name}"].causality) == ("V", "input")
    assert found[f"y.qd.{name}"].unit == "rad/s"
    assert found[f"y.current.{name}"].description == f"measured current, {name}"
    units = {each.name: each.baseUnit for each in description.unitDefinitions}
    assert (units["V"].kg, units["V"].m, units["V"].s, units["V"].A) == (1, 2, -3, -1)
    assert float(found[f"u.{name}"].start) == pytest.approx(0.0, abs=50.0)
    assert description.defaultExperiment.stepSize == "0.001"


def test_equal_units_have_equal_bytes(tmp_path):
    one, two = (aw.export.export_fmu(PLAIN, tmp_path / name / "plant.fmu", platforms=[]) for name in _folders(tmp_path))
    assert one.path.read_bytes() == two.path.read_bytes()


def _folders(place):
    for name in ("one", "two"):
        (place / name).mkdir()
    return ("one", "two")


@pytest.mark.parametrize(
    ("unit", "base"),
    [
        ("N m", {"kg": 1, "m": 2, "s": -2}),
        ("rad/s²", {"rad": 1, "s": -2}),
        ("°C", {"K": 1}),
        ("kg m²", {"kg": 1, "m": 2}),
        ("parsec", None),
    ],
)
def test_units_are_made_of_base_units(unit, base):
    assert base_unit(unit) == base


@pytest.mark.parametrize(
    ("label", "name"),
    [("elbow", "elbow"), ("joint-1", "'joint-1'"), ("0", "at0"), ("a'b", "'a_27b'"), ("Gelenk ä", "'Gelenk _e4'")],
)
def test_names_of_joints_are_quoted_where_they_must_be(label, name):
    assert quoted(label) == name


def test_joints_of_any_name_pass_the_validator(tmp_path):
    arm = pendulum(motor=MOTOR, friction=COULOMB, name="joint-1 (base)")
    path = aw.export.export_fmu(aw.Scenario(arm, loop=aw.Loop(period=1e-3)), tmp_path / "odd.fmu", platforms=[]).path
    assert validate_fmu(str(path)) == []


def test_a_controller_of_an_arm_without_motors_passes_the_validator(tmp_path):
    arm = pendulum("torque", name="ä")  # its current is not known: NaN
    loop = aw.Loop(aw.JointPID(kp=1.0), period=1e-3)
    path = aw.export.export_fmu(
        aw.Scenario(arm, duration=0.1, loop=loop), tmp_path / "law.fmu", part="controller", platforms=[]
    ).path
    assert validate_fmu(str(path)) == []
    starts = {each.name: each.start for each in read_model_description(str(path)).modelVariables}
    assert starts["y.current.'_e4'"] == "NaN"


def branching(t, r, y):
    return y.q if y.q[0] > 0 else -y.q


UNTRACED = aw.Loop(branching, period=1e-3)
SLOW = aw.Loop(period=1e-3, timing=aw.Timing(command_delay=900.0))


@pytest.mark.parametrize(
    ("options", "changes", "message"),
    [
        ({"name": "2 arms"}, {}, "^name = '2 arms': .*C identifier"),
        ({"name": "while"}, {}, "^name = 'while': .*C identifier"),
        ({"part": "motor"}, {}, "^part = 'motor': .*controller, plant$"),
        ({"version": "1.0"}, {}, r"^version = '1\.0': .*3\.0 or 2\.0\?$"),
        ({"interface": "me"}, {}, r"^interface = 'me'"),
        ({"platforms": ["amiga"]}, {}, r"^platforms = 'amiga': there is aarch64-darwin"),
        ({"part": "both"}, {}, r"^loop\.controller: no controller; .*FMU"),
        ({"part": "both", "interface": "model-exchange"}, {}, "^part = 'both': .*its ticks"),
        ({"part": "both"}, {"loop": UNTRACED, "duration": 0.1}, r"\(test_files\.py, line \d+\)"),
        ({}, {"start": aw.Batch([[0.0], [0.1]])}, "^lanes: 2 lanes; .*batches"),
        ({}, {"loop": SLOW}, r"^loop\.timing: 7\.2 MB .* shorter delays$"),
        ({}, {"solver": aw.Solver("cvodes")}, r"^solver\.integrator = 'cvodes': "),
    ],
)  # fmt: skip
def test_what_cannot_be_exported_is_refused(options, changes, message, tmp_path):
    path = tmp_path / "plant.fmu"
    with pytest.raises((ModelError, ScenarioError), match=message):
        aw.export.export_fmu(replace(PLAIN, **changes), path, **options)
    assert list(tmp_path.iterdir()) == []


def test_without_zig_other_systems_are_refused(monkeypatch, tmp_path):
    monkeypatch.setattr(build, "has_zig", lambda: False)
    other = next(name for name in build.PLATFORMS if name != build.host_platform())
    with raises_at(ArmwrightError, "platforms", r"pip install 'armwright\[fmu\]'"):
        aw.export.export_fmu(PLAIN, tmp_path / "plant.fmu", platforms=[other])
    monkeypatch.setattr(build, "find_compiler", lambda: None)
    exported = aw.export.export_fmu(PLAIN, tmp_path / "plant.fmu")
    assert not exported.platforms
    assert "no binaries: no C compiler here, and no zig" in exported.notes[0]


def test_the_command(tmp_path):
    this_platform()
    path = tmp_path / "swing.fmu"
    arguments = ["export", "fmu", str(EXAMPLES / "swing.scenario.toml"), "--part", "controller", "--platforms", "host"]
    done = CliRunner().invoke(app, [*arguments, "-o", str(path), "--json"])
    assert done.exit_code == 0, done.output
    (result,) = json.loads(done.stdout)["results"]
    assert result["part"] == "controller"
    assert list(result["platforms"]) == [build.host_platform()]
    assert validate_fmu(str(path)) == []
    for wrong, words in (
        (["-o", str(tmp_path / "swing.zip")], "the ending '.zip' is not offered"),
        (["-o", str(path), "--name", "3"], "is no C identifier"),
        (["-o", str(path), "--fmi", "1.0"], "did you mean 3.0 or 2.0?"),
    ):
        done = CliRunner().invoke(app, [*arguments, *wrong])
        assert done.exit_code == 2
        assert words in done.output
