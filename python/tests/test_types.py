"""The examples of the docs run, and mypy takes them and the package as strict."""

from __future__ import annotations

import inspect
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import isobrick

ROOT = Path(__file__).parents[2]


def examples(page: str = "PYTHON.md") -> list[str]:
    return re.findall(r"```python\n(.*?)```", (ROOT / "docs" / page).read_text(), re.DOTALL)


@pytest.mark.parametrize("page", ["PYTHON.md", "how-to/from-scikit-image.md"])
def test_examples_run_in_their_order(page: str, tmp_path: Path) -> None:
    program = tmp_path / "examples.py"
    program.write_text("\n".join(examples(page)))
    done = subprocess.run([sys.executable, program], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


def test_mypy_is_strict(tmp_path: Path) -> None:
    program = tmp_path / "examples.py"
    program.write_text("\n".join(examples()))
    for what in (["-p", "isobrick"], [str(program)]):
        done = subprocess.run(
            [sys.executable, "-m", "mypy", "--strict", "--config-file", str(ROOT / "pyproject.toml"), "--cache-dir",
             str(ROOT / "build" / "mypy"), *what],
            cwd=tmp_path, capture_output=True, text=True, timeout=600,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout


def test_stubs_name_what_the_module_has() -> None:
    import isobrick

    folder = Path(isobrick.__file__).parent
    assert (folder / "py.typed").exists()
    for module in ("_core", "_volumes"):
        stub = (folder / f"{module}.pyi").read_text()
        names = [n for n in dir(getattr(__import__(f"isobrick.{module}"), module)) if not n.startswith("_")]
        missing = [n for n in names if not re.search(rf"(class|def) {n}\b", stub)]
        assert missing == []


def parameters_of(docstring: str) -> list[str]:
    section = re.search(r"^Parameters\n-+\n(.*?)(?=^\w[\w ]*\n-+\n|\Z)", docstring, re.M | re.S)
    lines = re.findall(r"^(\S.*)$", section[1], re.M) if section else []
    return [name.strip().lstrip("*") for line in lines for name in line.split(",")]


def public_calls() -> Iterator[tuple[str, Callable[..., object]]]:
    for name in isobrick.__all__:
        member = getattr(isobrick, name)
        if inspect.isfunction(member):
            yield name, member
        elif inspect.isclass(member):
            for key, method in vars(member).items():
                if not key.startswith("_") and inspect.isfunction(method):
                    yield f"{name}.{key}", method


@pytest.mark.parametrize("name, call", list(public_calls()), ids=lambda one: one if isinstance(one, str) else "")
def test_docstrings_name_every_parameter(name: str, call: Callable[..., object]) -> None:
    docstring = inspect.getdoc(call) or ""
    assert docstring, f"{name} has no docstring"
    wanted = {one for one in inspect.signature(call).parameters if one != "self"}
    assert set(parameters_of(docstring)) == wanted
