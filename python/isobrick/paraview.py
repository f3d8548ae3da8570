"""Starts ParaView with the plugin of isobrick loaded:

    python -m isobrick.paraview [paraview | pvbatch | pvpython] [ARGUMENT...]

ParaView has a Python and a VTK of its own. It is led to this package alone, so that packages of the Python that
runs this, another VTK above all, do not come between.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from xml.sax.saxutils import quoteattr

PACKAGE = Path(__file__).parent
PROGRAMS = ("paraview", "pvbatch", "pvpython")

# ParaView 5.11 asks Python for a function that 3.11 has no more: without it no plugin in Python loads.
_SITE_CUSTOMIZE = """\
import inspect

if not hasattr(inspect, "getargspec"):
    inspect.getargspec = inspect.getfullargspec
"""


def environment(folder: Path) -> dict[str, str]:
    """For ParaView; ``folder`` is empty, and stays as long as it runs."""
    for part in [PACKAGE, *PACKAGE.parent.glob("isobrick-*.dist-info"), *PACKAGE.parent.glob("isobrick.libs")]:
        (folder / part.name).symlink_to(part)
    (folder / "sitecustomize.py").write_text(_SITE_CUSTOMIZE)
    plugin = folder / "isobrick" / "paraview_plugin.py"
    config = folder / "plugins.xml"
    config.write_text(
        f'<Plugins><Plugin name="isobrick" filename={quoteattr(str(plugin))} auto_load="1"/></Plugins>\n'
    )
    result = dict(os.environ)
    result["PYTHONPATH"] = os.pathsep.join(filter(None, [str(folder), os.environ.get("ISOBRICK_PARAVIEW_PYTHONPATH")]))
    result["PV_PLUGIN_CONFIG_FILE"] = str(config)
    result.pop("PYTHONHOME", None)
    return result


def main() -> int:
    """Runs ParaView to its end."""
    words = sys.argv[1:]
    program = words.pop(0) if words and Path(words[0]).name in PROGRAMS else "paraview"
    if shutil.which(program) is None:
        sys.exit(f"isobrick: '{program}' is not here; install ParaView (Debian: apt install paraview python3-paraview)")
    with tempfile.TemporaryDirectory(prefix="isobrick-paraview-") as folder:
        return subprocess.run([program, *words], env=environment(Path(folder)), check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
