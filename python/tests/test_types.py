"""The examples of the docs run, and mypy takes them and the package as strict."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

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
