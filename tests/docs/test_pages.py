"""Every command of the tutorials and of the how-to pages runs, on data that the page itself makes."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from pages import missing_line, run_page

from isobrick._command import EXECUTABLE

DOCS = Path(__file__).parents[2] / "docs"
TUTORIALS = sorted(set((DOCS / "tutorials").glob("*.md")) - {DOCS / "tutorials/index.md"})
HOW_TO = [page for page in sorted((DOCS / "how-to").glob("*.md")) if "```sh\n" in page.read_text()]


def environment(folder: Path) -> dict[str, str]:
    """A reader's environment: the command, this Python, and the library installed (tools/test.sh)."""
    programs = f"{EXECUTABLE.parent}:{Path(sys.executable).parent}"
    prefix = os.environ.get("CMAKE_PREFIX_PATH", str(Path(sys.prefix).parent / "prefix"))
    return {
        "PATH": f"{programs}:{os.environ['PATH']}",
        "XDG_CACHE_HOME": str(folder / ".cache"),
        "CMAKE_PREFIX_PATH": prefix,
    }


@pytest.mark.parametrize("page", TUTORIALS + HOW_TO, ids=lambda page: f"{page.parent.name}-{page.stem}")
def test_page(page: Path, tmp_path: Path) -> None:
    assert run_page(page, tmp_path, environment(tmp_path)) > 0


def test_the_readme(tmp_path: Path) -> None:
    """Its tour goes through the folder that the quickstart leaves; it is short."""
    readme = DOCS.parent / "README.md"
    for words in (("phantom", "head", "--voxels", "256", "-o", "head.nrrd"), ("build", "head.nrrd")):
        subprocess.run([EXECUTABLE, *words], cwd=tmp_path, check=True, capture_output=True)
    assert run_page(readme, tmp_path, environment(tmp_path)) >= 6
    assert len(readme.read_text().split()) <= 900


def test_links_lead_somewhere_in_the_repository() -> None:
    """Also for readers who have no site."""
    root = DOCS.parent
    pages = [*root.glob("*.md"), *DOCS.rglob("*.md"), *root.glob("python/**/*.md"), *root.glob("tools/*.md")]
    dead = []
    for page in pages:
        text = re.sub(r"```.*?```", "", page.read_text(), flags=re.S)
        for link in re.findall(r"\]\(([^)\s#]+)[^)]*\)", text):
            if not re.match("[a-z]+:", link) and not (page.parent / link).exists():
                dead.append(f"{page.relative_to(root)}: {link}")
    assert not dead


def test_there_are_tutorials() -> None:
    assert len(TUTORIALS) >= 6 and len(HOW_TO) >= 6


def test_a_page_that_fails_is_noticed(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```sh\necho one\n```\n```sh\ntrue\nfalse\ntrue\n```\n")
    with pytest.raises(AssertionError, match="page.md:4: the block fails"):
        run_page(page, tmp_path, {})
    page.write_text("```sh\necho 12 triangles\n```\n```text\n… triangles\n```\n")
    assert run_page(page, tmp_path, {}) == 1
    page.write_text("```sh\necho 12 triangles\n```\n```text\n13 triangles\n```\n")
    with pytest.raises(AssertionError, match="not printed: 13 triangles"):
        run_page(page, tmp_path, {})
    assert missing_line("b\na", "a\nb") == "a"


def test_no_page_is_too_long() -> None:
    """Two are exact on purpose."""
    may_be_longer = {"ALGORITHM.md", "FORMAT.md"}
    words = {page: len(page.read_text().split()) for page in DOCS.rglob("*.md") if page.name not in may_be_longer}
    assert not [f"{page}: {count} words" for page, count in words.items() if count > 2500]
