"""The site is built without a warning, and works without a network."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

from isobrick._command import EXECUTABLE

ROOT = Path(__file__).parents[2]


def test_the_site(tmp_path: Path) -> None:
    environment = {**os.environ, "ISOBRICK": str(EXECUTABLE)}
    done = subprocess.run([ROOT / "tools" / "site.sh", tmp_path], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "--simplify" in (tmp_path / "reference" / "options.html").read_text()
    assert "isobrick.Pyramid.extract" in (tmp_path / "reference" / "python.html").read_text()
    assert (tmp_path / "cpp" / "classisobrick_1_1Pyramid.html").exists()
    for page in set(tmp_path.rglob("*.html")) - set((tmp_path / "cpp").rglob("*.html")):
        text = page.read_text()
        assert 'src="http' not in text and 'rel="stylesheet" href="http' not in text, page
