"""The site is built without a warning, and its links lead somewhere."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from isobrick._command import EXECUTABLE

ROOT = Path(__file__).parents[2]
TOOLS = ROOT / "tools" / "site"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site") / "html"
    done = subprocess.run(
        [ROOT / "tools" / "site.sh", folder],
        env={**os.environ, "ISOBRICK": str(EXECUTABLE)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


def test_the_site_is_built_without_a_warning(site: Path) -> None:
    assert (site / "index.html").exists() and (site / "search" / "search_index.json").exists()
    assert "--simplify" in (site / "reference" / "options.html").read_text()
    assert "isobrick.Pyramid.extract" in (site / "reference" / "python.html").read_text()
    assert (site / "cpp" / "index.html").exists()


def test_a_warning_fails(site: Path, tmp_path: Path) -> None:
    for folder in ("docs", "tools/site", "python/isobrick"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    for file in ("mkdocs.yml", "tools/site.sh", "CONTRIBUTING.md", "CHANGELOG.md"):
        shutil.copy(ROOT / file, tmp_path / file)
    (tmp_path / "build/site").mkdir(parents=True)
    (tmp_path / "build/site/venv").symlink_to(ROOT / "build/site/venv")
    with open(tmp_path / "docs/GLOSSARY.md", "a") as page:
        page.write("[a page](GONE.md)\n")
    done = subprocess.run(
        [tmp_path / "tools/site.sh"],
        env={**os.environ, "ISOBRICK": str(EXECUTABLE)},
        capture_output=True,
        text=True,
    )
    assert done.returncode != 0 and "GONE.md" in done.stdout and "Aborted with 1 warnings" in done.stdout


def test_no_page_asks_another_host(site: Path) -> None:
    """Fonts and scripts come with the site: it works without a network."""
    for page in site.rglob("*.html"):
        if page.relative_to(site).parts[0] != "cpp":
            text = page.read_text()
            assert 'src="http' not in text and 'rel="stylesheet" href="http' not in text, page


@pytest.mark.parametrize("link", ["gone.html", "index.html#gone", "#gone"])
def test_a_link_that_leads_nowhere_is_found(link: str, tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text(f'<p id="here"><a href="index.html#here">a</a><a href="{link}">b</a></p>')
    done = subprocess.run(
        [sys.executable, TOOLS / "check_links.py", tmp_path], capture_output=True, text=True
    )
    assert done.returncode == 1 and link in done.stderr and "2 links of 1 pages, 1 lead" in done.stdout


def test_the_drawings_are_those_of_their_script(tmp_path: Path) -> None:
    subprocess.run([sys.executable, TOOLS / "drawings.py", tmp_path], check=True)
    drawn = {path.name: path.read_bytes() for path in tmp_path.glob("*.svg")}
    kept = {path.name: path.read_bytes() for path in (ROOT / "docs" / "figures").glob("how-*.svg")}
    assert drawn == kept and len(drawn) >= 10
