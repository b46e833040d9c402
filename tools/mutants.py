"""Plants 120 mistakes in the package, one at a time, and counts those that the tests find. Two cores: 50 minutes.

    .venv/bin/python -m pip install coverage
    .venv/bin/python tools/mutants.py map          which test executes which line, once (writes build/mutants)
    .venv/bin/python tools/mutants.py run [number …] [--seed 0] [--count 120] [--jobs 2] [--seconds 60]

A mistake is a changed comparison, sign, operator, number, condition or member of a list. It is planted in a copy of the tree, and
the tests that execute its line run there until one fails, frozen numbers and those of its room first: those of `make test`,
then those that only `make test-all` runs. What no test has found after `--seconds` of either is undecided. The line of a constant
is executed on import; tests that execute a line where its name stands count as its tests.
"""

from __future__ import annotations

import argparse
import ast
import copy
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "armwright"
KEPT = ROOT / "build" / "mutants"
ROOMS = {
    "physics": ("dynamics", "actuators", "model", "friction_laws", "joint_kinds", "kinematics"),
    "simulation": ("simulation",),
    "control": ("control", "tuning"),
    "identification": ("identification", "fitting"),
    "shadow": ("shadow",),
    "export": ("export",),
    "bus": ("twin",),
}
COPIED = ("src", "tests", "docs", "examples", "benchmarks", "tools", "pyproject.toml", "Makefile", "CHANGELOG.md",
          "README.md", "CONTRIBUTING.md", "requirements.lock", "LICENSE", ".ci")  # fmt: skip

# --- the map: a plugin of pytest, `-p mutants` ------------------------------------------------------------------------

COVERAGE = pytest.StashKey[object]()


def pytest_configure(config: pytest.Config) -> None:
    """Every process that runs tests writes the lines that each of them executes."""
    if os.environ.get("MUTANTS_MAP") and (hasattr(config, "workerinput") or not config.getoption("numprocesses", None)):
        from coverage import Coverage

        measured = Coverage(
            data_file=str(KEPT / "lines"), data_suffix=str(os.getpid()), source=[str(PACKAGE)], config_file=False
        )
        measured.set_option("run:relative_files", True)  # a map serves other copies of the tree
        measured.start()
        config.stash[COVERAGE] = measured


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Lines belong to the test that runs; how long its processor worked for it is written, too."""
    measured = item.config.stash.get(COVERAGE, None)
    if measured is None:
        return (yield)
    study = item.get_closest_marker("study") is not None
    before = sum(os.times()[:4])
    measured.switch_context(item.nodeid)
    try:
        return (yield)
    finally:
        measured.switch_context("")
        with (KEPT / f"seconds-{os.getpid()}.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps([item.nodeid, round(sum(os.times()[:4]) - before, 3), study]) + "\n")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of the tests of some files only those that a list names run, in its order: many names cannot stand on a command line."""
    if listed := os.environ.get("MUTANTS_TESTS"):
        order = {name: k for k, name in enumerate(Path(listed).read_text("utf-8").splitlines())}
        items[:] = sorted((item for item in items if item.nodeid in order), key=lambda item: order[item.nodeid])


def pytest_unconfigure(config: pytest.Config) -> None:
    """The lines of this process are kept."""
    if (measured := config.stash.get(COVERAGE, None)) is not None:
        measured.stop()
        measured.save()


def make_map(arguments: list[str]) -> None:
    """Runs all tests under the plugin. More words are pytest's: `map tests/twin`, `map -m study`."""
    shutil.rmtree(KEPT, ignore_errors=True)
    KEPT.mkdir(parents=True)
    paths = os.pathsep.join([str(ROOT / "tools"), str(ROOT / "src"), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "MUTANTS_MAP": "1", "PYTHONPATH": paths}
    command = [sys.executable, "-m", "pytest", "-p", "mutants", "-n", "2", "--dist", "loadfile", "-q", *arguments]
    subprocess.run(command, cwd=ROOT, env=environment, check=False)
    from coverage import Coverage

    whole = Coverage(data_file=str(KEPT / "lines"), config_file=False)
    whole.set_option("run:relative_files", True)
    whole.combine([str(KEPT)])
    whole.save()


@dataclass(frozen=True)
class Map:
    """Tests that execute each line, and how long they take."""

    lines: dict[str, dict[int, set[str]]]  # file → line → tests
    seconds: dict[str, float]
    studies: set[str]

    @classmethod
    def read(cls) -> Map:
        """The map that `make_map` kept."""
        from coverage import CoverageData

        data = CoverageData(str(KEPT / "lines"))
        data.read()
        lines = {
            str((ROOT / file).relative_to(PACKAGE)): {
                line: {each for each in tests if each} for line, tests in data.contexts_by_lineno(file).items()
            }
            for file in data.measured_files()
        }
        rows = [
            json.loads(row) for each in KEPT.glob("seconds-*.jsonl") for row in each.read_text("utf-8").splitlines()
        ]
        return cls(lines, {test: seconds for test, seconds, _ in rows}, {test for test, _, study in rows if study})

    def of(self, mutant: Mutant) -> list[str]:
        """The tests of a mutant: frozen numbers and those of its room, then others, the quickest first."""
        if mutant.constant:
            word = re.compile(rf"\b{re.escape(mutant.constant)}\b")
            found = set()
            for file, lines in self.lines.items():
                text = (PACKAGE / file).read_text("utf-8").splitlines()
                for line, tests in lines.items():
                    if word.search("".join(text[line - 1 : line])):  # a file may be shorter than it was
                        found |= tests
        else:
            lines = self.lines.get(mutant.file, {})
            found = lines.get(mutant.line) or set().union(*lines.values())  # of what runs on import: those of the file
        return sorted(found, key=lambda test: (not mutant.is_near(test), self.seconds.get(test, 0.0)))


# --- the mistakes -----------------------------------------------------------------------------------------------------

COMPARISONS = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq}
OPERATORS = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult}
PAIRS = ("maximum", "minimum"), ("sin", "cos"), ("max", "min"), ("any", "all")
NAMES = {one: other for pair in PAIRS for one, other in (pair, pair[::-1])}
JOINED = {ast.JoinedStr, ast.List, ast.Tuple, ast.ListComp}  # what + joins
LOOKS = {"pictures.py", "picture.py", "page.py", "plot.py"}  # judged by looking


@dataclass(frozen=True)
class Mutant:
    """One mistake: what stands in a file, and what is written in its place."""

    file: str  # in the package
    line: int
    start: int  # characters from the beginning of the file
    end: int
    new: str
    constant: str = ""  # name, if the line is executed on import only

    def planted(self, text: str) -> str:
        """The file with the mistake."""
        return text[: self.start] + self.new + text[self.end :]

    def is_near(self, test: str) -> bool:
        """True for tests of its room, and for frozen numbers."""
        return test.startswith(("tests/frozen/", f"tests/{self.file.split('/')[0]}/"))

    def __str__(self) -> str:
        text = (PACKAGE / self.file).read_text("utf-8")
        return (
            f"{self.file}:{self.line}: {' '.join(text[self.start : self.end].split())} → {' '.join(self.new.split())}"
        )


def changed(node: ast.AST) -> ast.AST | None:
    """The node with a mistake, or None where there is none to make."""
    node = copy.deepcopy(node)
    match node:
        case ast.Compare(ops=[op]) if type(op) in COMPARISONS:
            node.ops = [COMPARISONS[type(op)]()]
        case ast.BinOp(left=left, op=op, right=right) if (
            type(op) in OPERATORS and not {type(left), type(right)} & JOINED
        ):
            node.op = OPERATORS[type(op)]()
        case ast.UnaryOp(op=ast.USub() | ast.Not(), operand=operand):
            return operand
        case ast.BoolOp(op=op):
            node.op = ast.Or() if isinstance(op, ast.And) else ast.And()
        case ast.Constant(value=float(value)) if value:
            node.value = 2.0 * value
        case ast.Constant(value=bool(value)):
            node.value = not value
        case ast.Constant(value=int(value)):
            node.value = value + 1
        case ast.IfExp(test=test):
            node.test = ast.UnaryOp(ast.Not(), test)
        case ast.Name(id=name) | ast.Attribute(attr=name) if name in NAMES:
            if isinstance(node, ast.Name):
                node.id = NAMES[name]
            else:
                node.attr = NAMES[name]
        case ast.Tuple(elts=[_, _, *_], ctx=ast.Load()) | ast.Set(elts=[_, _, *_]) if all(
            isinstance(each, ast.Constant) and isinstance(each.value, str) for each in node.elts
        ):
            node.elts = node.elts[:-1]
        case _:
            return None
    return node


def mutants_of(path: Path) -> Iterator[Mutant]:
    """Every mistake that can be made in a file: not in messages, annotations and docstrings."""
    text = path.read_text("utf-8")
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))

    def place(line: int, column: int) -> int:  # columns of `ast` are bytes
        whole = text[starts[line - 1] : starts[line]]
        return starts[line - 1] + len(whole.encode()[:column].decode())

    def walk(node: ast.AST, constant: str) -> Iterator[Mutant]:
        if isinstance(node, ast.expr) and (new := changed(node)) is not None:
            start, end = place(node.lineno, node.col_offset), place(node.end_lineno or 0, node.end_col_offset or 0)
            yield Mutant(str(path.relative_to(PACKAGE)), node.lineno, start, end, f"({ast.unparse(new)})", constant)
        for name, value in ast.iter_fields(node):
            if name in {"annotation", "returns", "decorator_list", "slice", "bases"}:
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.JoinedStr | ast.Raise | ast.Assert | ast.ImportFrom | ast.Import):
                    continue
                if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
                    continue
                if isinstance(child, ast.keyword) and child.arg == "strict":  # of zip: a check that never fails
                    continue
                if isinstance(child, ast.AST):
                    inside = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
                    local = not constant or (inside and name == "body")  # in a function a name is no constant
                    yield from walk(child, "" if local else named(child) or constant)

    yield from walk(ast.parse(text), "?")


def named(node: ast.AST) -> str:
    """The name that a statement gives to a constant."""
    match node:
        case ast.Assign(targets=[ast.Name(id=name), *_]) | ast.AnnAssign(target=ast.Name(id=name)):
            return name
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
            return name
    return ""


def drawn(count: int, seed: int) -> list[Mutant]:
    """Mistakes of all rooms, as many of each."""
    source = random.Random(seed)
    found: list[Mutant] = []
    for k, folders in enumerate(ROOMS.values()):
        paths = [path for folder in folders for path in sorted((PACKAGE / folder).rglob("*.py"))]
        every = [each for path in paths if path.name not in LOOKS for each in mutants_of(path) if each.constant != "?"]
        found += source.sample(every, count // len(ROOMS) + (k < count % len(ROOMS)))
    return found


# --- the runs ---------------------------------------------------------------------------------------------------------


def tree(folder: Path) -> Path:
    """A copy of what tests need, with the measurements beside it."""
    copied = folder / "armwright"
    copied.mkdir(parents=True)
    for name in COPIED:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, copied / name, ignore=shutil.ignore_patterns("__pycache__"))
        elif source.exists():
            shutil.copy(source, copied / name)
    if (shared := ROOT.parent / "shared").exists():
        (folder / "shared").symlink_to(shared.resolve())
    return copied


def found_by(tests: list[str], copied: Path, seconds: float, cache: Path) -> str:
    """The first test that fails; "" if none does; "?" if time was up before."""
    if not tests:
        return ""
    listed = copied.parent / "tests.txt"
    listed.write_text("\n".join(tests) + "\n", "utf-8")
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(copied / "src"), str(copied / "tools")]),
        "MUTANTS_TESTS": str(listed),
        "ARMWRIGHT_TESTS_CACHE": str(cache),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    files = sorted({test.split("::")[0] for test in tests})
    words = ["-p", "mutants", "-x", "-q", "-p", "no:cacheprovider", "--no-header", "--tb=no"]
    command = [sys.executable, "-m", "pytest", *words, *files]
    try:
        ran = subprocess.run(
            command, cwd=copied, env=environment, capture_output=True, text=True, timeout=seconds, check=False
        )
    except subprocess.TimeoutExpired:
        return "?"
    if ran.returncode in (0, 5):
        return ""
    failed = re.search(r"^(?:FAILED|ERROR) (\S+)", ran.stdout, re.MULTILINE)
    if failed is None and ran.returncode == pytest.ExitCode.USAGE_ERROR and "conftest" not in ran.stderr:
        raise RuntimeError(ran.stderr)  # of this tool: nothing ran
    return failed[1] if failed else f"pytest ended with {ran.returncode}"  # what it imports fails


def run(mutants: list[Mutant], numbers: list[int], jobs: int, seconds: float) -> None:
    """Runs the tests of every mistake, prints a line for each and the table of them."""
    tests = Map.read()
    results: dict[int, tuple[str, str]] = {}
    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        cache = KEPT / "cache"
        cache.mkdir(mode=0o700, exist_ok=True)
        free = [tree(Path(folder) / str(k)) for k in range(jobs)]

        def one(number: int) -> None:
            copied = free.pop()
            mutant = mutants[number]
            path = copied / "src" / "armwright" / mutant.file
            text = path.read_text("utf-8")
            try:
                path.write_text(mutant.planted(text), "utf-8")
                every, start = tests.of(mutant), time.monotonic()
                quick = [each for each in every if each not in tests.studies]
                near = [
                    each for each in quick if mutant.is_near(each)
                ]  # a few files are collected sooner than a hundred
                test = found_by(near, copied, seconds, cache) or found_by(quick[len(near) :], copied, seconds, cache)
                verdict = "make test" if test not in {"", "?"} else "undecided" if test else "survived"
                if verdict != "make test" and (study := [each for each in every if each in tests.studies]):
                    test = found_by(study, copied, seconds, cache)
                    verdict = "make test-all" if test not in {"", "?"} else "undecided" if test else verdict
            finally:
                path.write_text(text, "utf-8")
                free.append(copied)
            results[number] = verdict, test
            took = time.monotonic() - start
            print(
                f"{number:4} {verdict:13} {mutant}   [{len(quick)} + {len(every) - len(quick)} tests, {took:.0f} s] {test}",
                flush=True,
            )

        with ThreadPoolExecutor(jobs) as pool:
            list(pool.map(one, numbers))
    table: dict[str, Counter[str]] = defaultdict(Counter)
    for number, (verdict, _) in results.items():
        room = next(name for name, folders in ROOMS.items() if mutants[number].file.split("/")[0] in folders)
        table[room][verdict] += 1
        table["all"][verdict] += 1
    verdicts = ("make test", "make test-all", "undecided", "survived")
    print("\n" + " | ".join(["room", *verdicts]))
    for room in [*ROOMS, "all"]:
        print(" | ".join([room, *(str(table[room][each]) for each in verdicts)]))


def main() -> None:
    """The command line."""
    if sys.argv[1:2] == ["map"]:
        make_map(sys.argv[2:])
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", choices=["run", "list"])
    parser.add_argument("numbers", nargs="*", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=120)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=60.0)
    chosen = parser.parse_args()
    mutants = drawn(chosen.count, chosen.seed)
    numbers = chosen.numbers or list(range(len(mutants)))
    if chosen.run == "list":
        for number in numbers:
            print(f"{number:4} {mutants[number]}")
    else:
        run(mutants, numbers, chosen.jobs, chosen.seconds)


if __name__ == "__main__":
    main()
