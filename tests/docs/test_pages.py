"""Every command of the tutorials and of the how-to pages runs, on data that the page itself makes."""

from __future__ import annotations

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from pages import missing_line, run_page

from isobrick._command import EXECUTABLE

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
TUTORIALS = sorted((DOCS / "tutorials").glob("*.md"))
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
    """Its commands run in the folder that the quickstart leaves."""
    for words in (("phantom", "head", "--voxels", "256", "-o", "head.nrrd"), ("build", "head.nrrd")):
        subprocess.run([EXECUTABLE, *words], cwd=tmp_path, check=True, capture_output=True)
    assert run_page(ROOT / "README.md", tmp_path, environment(tmp_path)) > 0


def test_the_readme_has_the_figures_of_the_league() -> None:
    with_front = runpy.run_path(str(ROOT / "tools/league.py"), run_name="league")["with_front"]
    readme = (ROOT / "README.md").read_text()
    assert with_front(readme, (DOCS / "league.md").read_text()) == readme


def test_what_pages_name_is_there() -> None:
    """Links, also for readers who have no site; in pages for developers, the files of the repository."""
    files = [Path(line) for line in subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).splitlines()]
    names = {file.name for file in files}
    missing = []
    for page in (file for file in files if file.suffix == ".md" and file.name not in ("CHANGELOG.md", "page.md")):
        text = re.sub(r"```.*?```", "", (ROOT / page).read_text(), flags=re.S)
        for link in re.findall(r"\]\(([^)\s#]+)[^)]*\)", text):
            if not re.match("[a-z]+:", link) and not (ROOT / page).parent.joinpath(link).exists():
                missing.append(f"{page}: {link}")
        if page.name in ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md"):
            named = re.findall(r"(?<![*\w])[a-z]\w*\.(?:h|cpp|py|sh)\b", text)
            missing += [f"{page}: {name}" for name in named if name not in names]
    assert not missing


def test_versions_agree() -> None:
    def text(name: str) -> str:
        return (ROOT / name).read_text()

    (version,) = re.findall(r"project\(isobrick VERSION ([0-9.]+)", text("CMakeLists.txt"))
    assert text("debian/changelog").startswith(f"isobrick ({version}) ")
    assert f"\nversion: {version}\n" in text("CITATION.cff") and f"\n## {version}" in text("CHANGELOG.md")
    known = re.findall(r" kVersion\w* = (\d+);", text("storage/format.h"))
    formats = f"versions {known[0]} to {known[-1]}"
    assert formats in text("docs/FORMAT.md") and formats in text("docs/LIMITS.md")


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
    page.write_text("```sh\ncat scan\n```\n<!-- runs first -->\n```sh\ntouch scan\n```\n")
    assert run_page(page, tmp_path, {}) == 2
    assert missing_line("b\na", "a\nb") == "a"
