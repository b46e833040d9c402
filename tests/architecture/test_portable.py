"""Code that one system runs and another does not, found in the syntax trees: encodings, modules and functions of one system.

Where such code is guarded by a question for the system, it stands in GUARDED with the guard.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FILES = sorted([*(ROOT / "src").rglob("*.py"), *(ROOT / "examples").rglob("*.py")])
ONE_SYSTEM = {  # modules
    *("curses", "fcntl", "grp", "msvcrt", "posix", "pty", "pwd", "readline", "resource", "syslog", "termios", "tty"),
    *("winreg", "winsound"),
}
MISSING = {  # of os and signal, on Windows; os.kill(…, 0) is there, and ends the other process
    *(
        "fork",
        "forkpty",
        "geteuid",
        "getegid",
        "getgid",
        "getloadavg",
        "getpgid",
        "getuid",
        "kill",
        "killpg",
        "mkfifo",
        "nice",
    ),
    *(
        "openpty",
        "posix_fallocate",
        "posix_spawn",
        "sched_getaffinity",
        "sched_setaffinity",
        "sched_setscheduler",
        "setsid",
    ),
    *("statvfs", "sysconf", "ttyname", "uname", "wait", "waitpid"),
    *("SIGALRM", "SIGHUP", "SIGKILL", "SIGQUIT", "SIGUSR1", "SIGUSR2", "alarm", "pause", "setitimer", "sigwait"),
}
GUARDED = {
    "src/armwright/output.py: kill": "os.name",
    "src/armwright/kernels/cache.py: geteuid": "sys.platform",
    "src/armwright/twin/serial/terminal.py: openpty": "sys.platform",
    "src/armwright/twin/serial/terminal.py: ttyname": "sys.platform",
}
PLACES = ("/dev/", "/etc/", "/home/", "/proc/", "/root/", "/sys/", "/tmp/", "/usr/", "/var/", "C:\\")
NAMED = {  # that no other system needs
    "src/armwright/kernels/target.py: /sys/devices/system/cpu/cpu0/cache/index3/size",
    "src/armwright/kernels/target.py: /usr/lib/libSystem.B.dylib",
    "src/armwright/twin/serial/terminal.py: /dev/pts/",
    "src/armwright/twin/serial/terminal.py: /dev/tty",
}


def problems(tree: ast.AST) -> Iterator[str]:
    """Names and short reasons, in the order of the file."""
    within = {id(inner) for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) for inner in ast.walk(node)}
    documents = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            yield from _without_encoding(node)
        elif isinstance(node, (ast.Import, ast.ImportFrom)) and id(node) not in within:
            names = [node.module] if isinstance(node, ast.ImportFrom) else [each.name for each in node.names]
            yield from (f"import {name}" for name in names if name in ONE_SYSTEM)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if node.value.id in ("os", "signal") and node.attr in MISSING:
                yield node.attr
        elif isinstance(node, ast.Constant) and id(node) not in documents and str(node.value).startswith(PLACES):
            yield str(node.value)


def _without_encoding(call: ast.Call) -> Iterator[str]:
    """Texts read or written in the encoding that the system happens to have."""
    function, given = call.func, {each.arg: each.value for each in call.keywords}
    if "encoding" in given or None in given:
        return
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    if name == "open" and isinstance(function, ast.Name):
        mode = given.get("mode", call.args[1] if len(call.args) > 1 else None)
        if not (isinstance(mode, ast.Constant) and "b" in str(mode.value)):
            yield "open without encoding"
    elif (name == "read_text" and isinstance(function, ast.Attribute) and not call.args) or name == "write_text":
        yield f"{name} without encoding"
    elif name in ("run", "Popen", "check_output") and {"text", "universal_newlines"} & set(given):
        yield f"{name}(text=True) without encoding"


def test_every_system_runs_the_source() -> None:
    found = set()
    for file in FILES:
        name, text = file.relative_to(ROOT).as_posix(), file.read_text(encoding="utf-8")
        here = {f"{name}: {each}" for each in problems(ast.parse(text))}
        assert all(GUARDED[each] in text for each in here & set(GUARDED)), name
        found |= here
    assert found == set(GUARDED) | NAMED


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("Path('a').read_text()", ["read_text without encoding"]),
        ("path.write_text(text)", ["write_text without encoding"]),
        ("open(path)", ["open without encoding"]),
        ("open(path, 'rb')", []),
        ("open(path, encoding='utf-8')", []),
        ("subprocess.run(words, text=True)", ["run(text=True) without encoding"]),
        ("import termios", ["import termios"]),
        ("def f():\n    import termios", []),
        ("os.kill(1, 0)", ["kill"]),
        ("path = '/tmp/x'", ["/tmp/x"]),
        ("'''/tmp/x in a docstring'''", []),
    ],
)
def test_each_is_found(code: str, found: list[str]) -> None:
    assert list(problems(ast.parse(code))) == found
