"""Records of rare tables of robot files: imported, with their validators, when the first one is read.

Pydantic turns every type that a record names into a checker. For all that a robot file may hold, this takes as long as to
read several robots.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import GetCoreSchemaHandler, TypeAdapter, ValidationInfo
from pydantic_core import CoreSchema, core_schema


@dataclass(frozen=True)
class Later:
    """A type of record, or one of several, by its import path."""

    module: str
    name: str

    @property
    def kind(self) -> Any:
        """The type itself."""
        return getattr(importlib.import_module(self.module), self.name)

    def __get_pydantic_core_schema__(self, _: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """A call of its checker, which is not built yet."""
        return core_schema.with_info_plain_validator_function(_checker(self))


def _checker(later: Later) -> Callable[[Any, ValidationInfo], Any]:
    built: list[TypeAdapter[Any]] = []

    def checked(value: Any, info: ValidationInfo) -> Any:
        """The value as a record; pydantic puts the place of this one before those of its errors."""
        if not built:
            kind = later.kind
            if hasattr(kind, "model_rebuild"):
                kind.model_rebuild()  # with what writes it: until pydantic 2.14, a field of type Any could not do that later
            built.append(TypeAdapter(kind))
        return built[0].validate_python(value, context=info.context)

    return checked


def imported_later(module: str, *names: str) -> tuple[Any, ...]:
    """Types to annotate with, for records of a module that type checkers import."""
    return tuple(Annotated[Any, Later(module, name)] for name in names)
