"""Every public function says what it takes and gives: arguments by name, arrays with shape and unit, the result."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from typing import Any

import pytest

import armwright as aw
from armwright.kernels.signatures import SIGNATURES
from public_names import PUBLIC

FUNCTIONS = [name for name, value in PUBLIC.items() if inspect.isfunction(value)]
SECTION = r"^{}:\n(?P<text>(?:[ ]+.*\n?)+)"
ARRAYS = ("q", "qd", "qdd", "tau", "voltage", "u", "wrench")
SHAPED = r"\([^)]*\)"


def _section(function: Callable[..., Any], name: str) -> str:
    found = re.search(SECTION.format(name), inspect.getdoc(function) or "", re.MULTILINE)
    return found["text"] if found else ""


@pytest.mark.parametrize("name", FUNCTIONS)
def test_arguments_are_told_by_name(name: str) -> None:
    function = PUBLIC[name]
    arguments = _section(function, "Args")
    for parameter in inspect.signature(function).parameters:
        assert re.search(rf"(^|\s){parameter}: \S", arguments), f"{name} says nothing of {parameter}"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_result_is_told(name: str) -> None:
    function = PUBLIC[name]
    if inspect.signature(function).return_annotation == "None":
        return
    assert _section(function, "Returns"), f"{name} does not say what it returns"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_arrays_have_shape_and_unit(name: str) -> None:
    function = PUBLIC[name]
    arguments = _section(function, "Args")
    for parameter in set(inspect.signature(function).parameters) & set(ARRAYS):
        place = re.search(rf"(^|\s){parameter}: (?P<text>.*?)(?=   \w+: |$)", arguments, re.MULTILINE)
        assert place is not None
        assert re.match(rf"{SHAPED} \[.+\]", place["text"]) or re.search(rf"{SHAPED}.*\[.+\]|\[.+\]", arguments), name
    if name in SIGNATURES or "energy" in name:
        assert re.search(rf"{SHAPED}.*\[.+\]", _section(function, "Returns"), re.DOTALL), f"{name}: what, in what unit?"


@pytest.mark.parametrize("name", sorted(SIGNATURES))
def test_compiled_kernels_tell_shape_and_unit_of_everything(name: str) -> None:
    method, signature = getattr(aw.CompiledArm, name), SIGNATURES[name]
    for argument in (*signature.inputs, *signature.optional):
        line = rf"{argument.name}: \(…, .+\) \[{re.escape(argument.unit)}\]"
        assert re.search(line, _section(method, "Args")), f"{name}: {argument.name}"
    assert re.search(rf"\[{re.escape(signature.outputs[0].unit)}\]", _section(method, "Returns"))
    assert (inspect.getdoc(method) or "").split("\n")[0].strip()


@pytest.mark.parametrize("name", [name for name, value in PUBLIC.items() if inspect.isclass(value)])
def test_classes_and_their_methods_are_explained(name: str) -> None:
    thing = PUBLIC[name]
    assert inspect.getdoc(thing)
    for method, function in vars(thing).items():
        if not method.startswith("_") and inspect.isfunction(function):
            assert inspect.getdoc(function), f"{name}.{method} has no docstring"
