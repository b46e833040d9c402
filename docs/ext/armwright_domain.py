"""The Python reference as objects of Sphinx's Python domain.

Its pages are plain Markdown, which a code host shows as it is. Where Sphinx reads them, the generated entries are made once more
as directives (`py:function`, `py:class`, ...): signatures with types that are links, every public name and member in
`objects.inv`, links to the source.
"""

from __future__ import annotations

import ast
import dataclasses
import functools
import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

import armwright_api as reference
import armwright_pages as pages
from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

import armwright as aw
from armwright.kernels import kernel_methods

FOLDER = "reference/python/"
ELSEWHERE = {  # names in our signatures, and what other projects' inventories call them
    "Any": "typing.Any",
    "ArrayLike": "numpy.typing.ArrayLike",
    "Callable": "collections.abc.Callable",
    "Collection": "collections.abc.Collection",
    "Figure": "matplotlib.figure.Figure",
    "Iterable": "collections.abc.Iterable",
    "Iterator": "collections.abc.Iterator",
    "Literal": "typing.Literal",
    "Mapping": "collections.abc.Mapping",
    "NDArray": "numpy.typing.NDArray",
    "PPoly": "scipy.interpolate.PPoly",
    "Path": "pathlib.Path",
    "PathLike": "os.PathLike",
    "Self": "typing.Self",
    "Sequence": "collections.abc.Sequence",
    "Unpack": "typing.Unpack",
    "np.dtype": "numpy.dtype",
    "np.ndarray": "numpy.ndarray",
    "xr.Dataset": "xarray.Dataset",
}
MEANING = {  # of names that only our signatures use
    "AnyArm": "Model | PathLike",
    "AnyLog": "Log | PathLike",
    "AnyMeasurements": "Measurements | PathLike",
    "AnyMotion": "Motion | PathLike",
    "AnyRun": "xr.Dataset | PathLike",
    "AnyScenario": "Scenario | PathLike",
    "Array": "ArrayLike",
    "Scalar": "float",
    "ValueWithStd": "float | tuple[float, float]",
}
ALIASES = re.compile(rf"\b({'|'.join(MEANING)})\b")
PROGRESS = "Callable | bool | None"  # of an argument `progress`


def setup(app: Sphinx) -> dict[str, bool]:
    """Connects the extension."""
    app.connect("source-read", read_page)
    app.connect("missing-reference", find_name, priority=400)  # before intersphinx
    app.connect("viewcode-follow-imported", home_of)
    app.connect("doctree-read", shorten_names)
    return {"parallel_read_safe": True}


def read_page(app: Sphinx, docname: str, source: list[str]) -> None:
    """Puts directives into the place of the generated entries of a page."""
    if docname.startswith(FOLDER):
        group = docname.removeprefix(FOLDER)
        made = {"api": directives, "api-others": lambda group: directives(*reference.names_of_others(group))}
        module = ".".join(["armwright", group] if group != "index" else ["armwright"])
        text = pages.MARK.sub(lambda mark: pages.part(mark, Path(app.srcdir, f"{docname}.md"), made), source[0])
        title, newline, rest = text.partition("\n")
        source[0] = f"{title}{newline}\n```{{py:module}} {module}\n```\n{rest}{elsewhere(group)}"


def elsewhere(group: str) -> str:
    """Entries for names of a group that the page of the top explains."""
    entries = []
    for name in getattr(getattr(aw, group, None), "__all__", ()):
        if name in aw.__all__:
            thing, text = getattr(aw, name), f"The same as {{py:obj}}`aw.{name} <armwright.{name}>`."
            entries.append(
                directive(kind_of(thing), f"{name}{signature(thing)}", [text], {"module": f"armwright.{group}"})
            )
    return "\n\n".join(["\n\n## Also at the top", *entries, ""]) if entries else ""


def directives(*lines: str) -> str:
    """Directives for names of `armwright`, one on each line, as `armwright_api.api` makes headings."""
    return "\n\n".join(entry(*reference.parsed(line.strip())) for line in lines if line.strip())


def entry(path: str, shown: str | None, chosen: list[str]) -> str:
    """Directive of a name. Members that the page does not choose follow in a part that is opened by hand."""
    thing = reference.found(path)
    module, _, name = f"armwright.{path}".rpartition(".")
    options = {"module": module}
    if inspect.ismodule(thing):
        return directive("module", f"armwright.{path}", reference.body(thing))
    home = f"{getattr(thing, '__module__', module)}.{getattr(thing, '__qualname__', name)}"
    if home != f"{module}.{name}" and home.startswith("armwright."):
        options["canonical"] = home
    content = list(reference.body(thing))
    if inspect.isclass(thing):
        if "**Attributes**" in content:  # of which each becomes an object
            place = content.index("**Attributes**")
            del content[place : place + 2]
        content += members(thing, chosen)
    return directive(kind_of(thing), f"{name}{signature(thing) if shown is None else shown}", content, options, depth=1)


def members(thing: type, chosen: list[str]) -> Iterator[str]:
    """Directives of attributes, of the chosen members, and of all others with the first paragraph of what they say."""
    attributes = reference.entries_of(inspect.getdoc(thing) or "", "Attributes")
    named = {
        n.strip(): text for each in attributes for names, _, text in [each.partition(": ")] for n in names.split(",")
    }
    known = {n: text for n, text in named.items() if n.isidentifier() and n not in chosen}
    for name, text in known.items():
        yield member(thing, name, [reference.escaped(text)])
    for name in chosen:
        yield member(thing, name, list(reference.body(inspect.getattr_static(thing, name, None))))
    rest = sorted({n for n in public_members(thing) if n not in known and n not in chosen})
    if rest:
        yield '<details class="members"><summary>Other members</summary>'
        for name in rest:
            yield member(thing, name, list(reference.body(inspect.getattr_static(thing, name, None)))[:1])
        yield "</details>"


def public_members(thing: type) -> Iterator[str]:
    """Methods, properties and fields of a class, those that it inherits from another of ours too."""
    for owner in thing.__mro__:
        if owner.__module__.startswith("armwright"):
            for name, value in [*vars(owner).items()]:
                value = reference.function_of(value)
                if not name.startswith("_") and (inspect.isfunction(value) or isinstance(value, property)):
                    yield name
            yield from (n for n in getattr(owner, "model_fields", ()) if not n.startswith("_"))
            fields = dataclasses.fields(owner) if dataclasses.is_dataclass(owner) else ()
            yield from (field.name for field in fields if not field.name.startswith("_"))


def member(thing: type, name: str, content: list[str]) -> str:
    """Directive of a method, a property or an attribute. The page's table of contents leaves it out, which all pages copy."""
    static = inspect.getattr_static(thing, name, None)
    function = reference.function_of(static)
    options = {"no-contents-entry": ""}
    if isinstance(function, property) or isinstance(static, functools.cached_property):
        getter = function.fget if isinstance(function, property) else function
        return directive(
            "property", name, content, options | typed(getattr(getter, "__annotations__", {}).get("return"))
        )
    if inspect.isfunction(function):
        if isinstance(static, (classmethod, staticmethod)):
            options[type(static).__name__] = ""
        if isinstance(static, kernel_methods.KernelMethod):
            return directive("method", f"{name}{kernel_signatures()[name]}", content, options)
        return directive("method", f"{name}{signature(function, isinstance(static, staticmethod))}", content, options)
    annotations = [vars(owner).get("__annotations__", {}) for owner in thing.__mro__]
    written = next((each[name] for each in annotations if name in each), None)
    return directive("attribute", name, content, options | typed(written))


@functools.cache
def kernel_signatures() -> dict[str, str]:
    """Signatures of the kernels' methods, which are made when the package is imported, from their stub."""
    tree = ast.parse(Path(kernel_methods.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    methods = [each for each in ast.walk(tree) if isinstance(each, ast.FunctionDef) and each.returns]
    return {
        f.name: f"({ast.unparse(f.args).removeprefix('self, ')}) -> {ast.unparse(f.returns)}"
        for f in methods
        if f.returns
    }


def typed(annotation: Any) -> dict[str, str]:
    """The option of a directive that says a type."""
    return {} if annotation is None else {"type": repr(Written(annotation))}


def kind_of(thing: Any) -> str:
    """Directive for it."""
    if inspect.isclass(thing):
        return "exception" if issubclass(thing, BaseException) else "class"
    return "function" if callable(thing) else "data"


def directive(kind: str, line: str, content: Any, options: dict[str, str] | None = None, depth: int = 0) -> str:
    """A directive of the Python domain in Markdown."""
    colons = ":" * (3 + depth)
    head = [f"{colons}{{py:{kind}}} {line}", *(f":{name}: {value}".rstrip() for name, value in (options or {}).items())]
    return "\n".join([*head, "", "\n\n".join(content), colons])


def signature(thing: Any, first: bool = False) -> str:
    """Arguments with types as they are written in the source, and defaults."""
    if not callable(thing) or getattr(thing, "_is_protocol", False):
        return ""
    found = inspect.signature(thing)
    given = [p for p in found.parameters.values() if first or p.name not in ("self", "cls")]
    shown = [reference.shown_default(p) for p in given]
    shown = [p.replace(annotation=PROGRESS) if p.name == "progress" else p for p in shown]
    kept = [p if p.annotation is p.empty else p.replace(annotation=Written(p.annotation)) for p in shown]
    result = found.return_annotation
    returned = found.empty if inspect.isclass(thing) or result is found.empty else Written(result)
    return str(inspect.Signature(kept, return_annotation=returned))


class Written:
    """An annotation as the source has it, with our aliases written out."""

    def __init__(self, annotation: Any) -> None:
        text = annotation if isinstance(annotation, str) else inspect.formatannotation(annotation)
        text = (
            re.sub(r"\barmwright\.[\w.]+\.", "", text).replace("str | os.PathLike[str]", "PathLike").replace("'", '"')
        )
        self.text = ALIASES.sub(lambda name: MEANING[name[0]], text)

    def __repr__(self) -> str:
        return self.text


def find_name(app: Sphinx, env: BuildEnvironment, node: addnodes.pending_xref, inner: nodes.Element) -> Any:
    """Leads a type that a signature names by its last word to the public name, or to that of another project."""
    target = node.get("reftarget")
    if node.get("refdomain") != "py":
        return None
    node["reftarget"] = ELSEWHERE.get(target, target)
    full = full_names().get(target)
    domain = env.domains.python_domain
    return full and domain.resolve_xref(env, node["refdoc"], app.builder, "obj", full, node, inner)


@functools.cache
def full_names() -> dict[str, str]:
    """Public names by their last word."""
    groups = {name: getattr(aw, name) for name in aw.__all__ if inspect.ismodule(getattr(aw, name))}
    names = {name: f"armwright.{group}.{name}" for group, module in groups.items() for name in module.__all__}
    return names | {name: f"armwright.{name}" for name in aw.__all__ if name not in groups}


def home_of(app: Sphinx, module: str, attribute: str) -> str | None:
    """Module whose source has a public name."""
    path = ".".join([*module.split(".")[1:], attribute.partition(".")[0]])
    thing = reference.found(path)
    return getattr(thing, "__module__", None)


def shorten_names(app: Sphinx, tree: nodes.document) -> None:
    """Signatures begin with `aw.`, as programs write it."""
    for node in tree.findall(addnodes.desc_addname):
        module = node.astext()
        if module == "armwright." or module.split(".")[1] in aw.__all__:
            node.children = [nodes.Text(module.replace("armwright.", "aw.", 1))]
