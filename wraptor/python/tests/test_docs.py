"""The docstrings that help() shows are those of the type stubs."""

import ast
import inspect
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

import wraptor
from wraptor import sim

STUBS = [(wraptor, "__init__.pyi"), (sim, "sim.pyi")]


def documented(module: ModuleType, stub: str) -> Iterator[tuple[str, object, ast.ClassDef | ast.FunctionDef]]:
    """Functions, classes and public members of a stub, with what they are at run time."""
    folder = Path(wraptor.__file__).parent
    for item in ast.parse((folder / stub).read_text()).body:
        if isinstance(item, ast.ClassDef):
            cls = getattr(module, item.name)
            yield item.name, cls, item
            for member in item.body:
                if isinstance(member, ast.FunctionDef) and not member.name.startswith("_"):
                    yield f"{item.name}.{member.name}", getattr(cls, member.name), member
        elif isinstance(item, ast.FunctionDef):
            yield item.name, getattr(module, item.name), item


@pytest.mark.parametrize(("module", "stub"), STUBS)
def test_docstrings_are_those_of_the_stubs(module: ModuleType, stub: str) -> None:
    found = {name: inspect.cleandoc(getattr(value, "__doc__") or "") for name, value, _ in documented(module, stub)}
    expected = {name: ast.get_docstring(item) for name, _, item in documented(module, stub)}
    assert found == expected and all(expected.values()) and len(expected) > 30
