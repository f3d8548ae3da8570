"""Surfaces in a cell of a notebook, or in a browser: the page of ``isobrick serve``."""

from __future__ import annotations

import base64
import contextlib
import html
import http.client
import importlib.util
import json
import os
import socket
import subprocess
import sys
import tempfile
import webbrowser
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from ._command import environment, executable, without_urls
from ._errors import Error
from ._pyramid import Pyramid, _whole_path
from ._sizes import DEFAULT_MEMORY, byte_size

# The shell ends the server when its own input ends: also if this process is killed. It keeps nothing of the server's
# output, so that this ends with the server.
_HOLD = '"$@" </dev/null & exec >/dev/null 2>&1; read -r _; kill $!; wait'


class _PageServer:
    """A running ``isobrick serve`` of one volume, which ends with this object and with the process."""

    def __init__(self, words: list[str], urls: dict[str, str]) -> None:
        with tempfile.TemporaryFile("w+") as complaints:
            process = subprocess.Popen(
                ["sh", "-c", _HOLD, "sh", *words],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=complaints,
                env=environment() | urls,
                text=True,
                start_new_session=True,  # Ctrl-C and the notebook's stop button are for the cell alone
            )
            self._process = process
            self.end = weakref.finalize(self, _end, process, os.getpid())
            assert process.stdout is not None
            self.address, _, self.key = process.stdout.readline().strip().partition("/#token=")
            if not self.key:
                self.end()
                complaints.seek(0)
                said = complaints.read().strip().removeprefix("isobrick: ")
                raise Error(said.splitlines()[-1] if said else "isobrick serve ended at once")
        status, body = self.get("/")
        if status != 200:
            self.end()
            raise Error(json.loads(body)["error"])

    @property
    def port(self) -> int:
        return int(self.address.rpartition(":")[2])

    def get(self, path: str) -> tuple[int, bytes]:
        """The answer to a request without the key."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=10)
        try:
            connection.request("GET", path)
            answer = connection.getresponse()
            return answer.status, answer.read()
        finally:
            connection.close()

    def is_running(self) -> bool:
        try:
            return self.end.alive and self.get("/healthz")[0] == 200
        except OSError:
            return False

    def wait(self) -> None:
        assert self._process.stdout is not None
        self._process.stdout.read()  # it says nothing more, but ends


def _end(process: subprocess.Popen[str], owner: int) -> None:
    if os.getpid() != owner:  # a child of fork()
        return
    assert process.stdin is not None and process.stdout is not None
    process.stdin.close()
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(10)
    process.stdout.close()


# One a volume, for all that show it.
_servers: weakref.WeakValueDictionary[tuple[str, ...], _PageServer] = weakref.WeakValueDictionary()
# What nobody has to keep: pages in tabs of the browser.
_opened: list[BrowserView] = []


class BrowserView:
    """A page with surfaces that ``isobrick.show`` made. As the result of a notebook's cell it is the page itself.

    Its server ends with ``close()``, with the last view of its volume, and with the process.
    """

    def __init__(self, server: _PageServer, fragment: str, notebook: _Notebook | None, size: tuple[str, str]) -> None:
        self._server = server
        self._fragment = fragment
        self._notebook = notebook
        self._size = size

    @property
    def url(self) -> str:
        """The address for a browser on this machine. Who has it has the volume."""
        return f"{self._server.address}/{self._fragment}"

    def close(self) -> None:
        """Ends the server, also for other views of the same volume. Pages that are open say that it is gone."""
        self._server.end()

    def wait(self) -> None:
        """Returns when the server has ended, or with Ctrl-C: the last line of a script."""
        with contextlib.suppress(KeyboardInterrupt):
            self._server.wait()

    def __repr__(self) -> str:
        return f"<isobrick.BrowserView {self.url}>"

    def _repr_html_(self) -> str:
        notebook = self._notebook or _Notebook()
        place = notebook.place_of(self._server.port)
        source = html.escape((place or self._server.address + "/") + self._fragment)
        width, height = map(html.escape, self._size)
        # The server refuses pages of origins that it was not told; only the browser knows the notebook's.
        hint = (
            "if (location.protocol.startsWith('http') && "
            f"!{json.dumps(notebook.origins)}.includes(location.origin)) "
            "document.currentScript.previousElementSibling.textContent = "
            "`This notebook is at ${location.origin}: isobrick.show(..., origin='${location.origin}') lets it in.`;"
        )
        return (
            f'<iframe src="{source}" width="{width}" height="{height}" style="border:0" title="isobrick" '
            'allow="fullscreen; clipboard-write"></iframe><br>'
            f'<a href="{source}" target="_blank" rel="noopener">in a tab of its own</a> '
            f"<span></span><script>{hint}</script>"
        )


class _Notebook:
    """Where the notebook is: its origins, and the path at which it hands ports of this machine on."""

    def __init__(self, origin: str | None = None, proxy: bool | str | None = None) -> None:
        hub_path = os.environ.get("JUPYTERHUB_SERVICE_PREFIX", "")
        server = _jupyter_server()
        base = hub_path or server.get("base_url", "/")
        self.origins = [origin] if origin else _origins_of(server)
        if proxy is None:
            has_proxy = importlib.util.find_spec("jupyter_server_proxy") is not None
            proxy = bool(hub_path) or (bool(server) and has_proxy)
        self._proxy = proxy if isinstance(proxy, str) else f"{base}proxy/{{port}}/" if proxy else None

    def place_of(self, port: int) -> str | None:
        return None if self._proxy is None else self._proxy.replace("{port}", str(port))


def _jupyter_server() -> dict[str, Any]:
    """What the Jupyter server that started this kernel wrote of itself; nothing: there is none on this machine."""
    try:
        from jupyter_core.paths import jupyter_runtime_dir
    except ImportError:
        return {}
    file = Path(jupyter_runtime_dir()) / f"jpserver-{os.environ.get('JPY_PARENT_PID', '')}.json"
    try:
        return dict(json.loads(file.read_text()))
    except (OSError, ValueError):
        return {}


def _origins_of(server: dict[str, Any]) -> list[str]:
    """How browsers may name the notebook's server, as far as this process can know."""
    given = os.environ.get("ISOBRICK_ORIGIN") or os.environ.get("JUPYTERHUB_PUBLIC_URL")
    given = given or os.environ.get("JUPYTERHUB_HOST")
    if given:
        parts = urlsplit(given)
        return [f"{parts.scheme}://{parts.netloc}"]
    if not server:
        return []
    scheme, usual = ("https", 443) if server.get("secure") else ("http", 80)
    port = "" if server["port"] == usual else f":{server['port']}"
    named = server.get("hostname", "")
    hosts = ["localhost", "127.0.0.1", socket.gethostname(), *([named] if named[:1].isalpha() else [])]
    return sorted({f"{scheme}://{host}{port}".lower() for host in hosts})


def _in_notebook() -> bool:
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return getattr(shell, "kernel", None) is not None


def _fragment_of(key: str, isovalue: float | None, view: Mapping[str, Any] | str | os.PathLike[str] | None) -> str:
    state: dict[str, Any] = {}
    if view is not None:
        state = dict(view) if isinstance(view, Mapping) else json.loads(Path(view).read_text())
    if isovalue is not None:
        first, *others = state.get("surfaces") or [{}]
        state["surfaces"] = [{**first, "isovalue": float(isovalue)}, *others]
    fragment = f"#token={key}"
    if state:
        text = base64.urlsafe_b64encode(json.dumps(state).encode()).decode().rstrip("=")
        fragment += f"&volume=0&view={text}"
    return fragment


def show(
    source: Pyramid | str | os.PathLike[str],
    *,
    isovalue: float | None = None,
    view: Mapping[str, Any] | str | os.PathLike[str] | None = None,
    width: int | str = "100%",
    height: int | str = 560,
    memory: int | str | None = None,
    threads: int = 0,
    origin: str | None = None,
    proxy: bool | str | None = None,
    browser: bool = True,
) -> BrowserView:
    """Explores surfaces of a pyramid in a notebook or a browser, by ``isobrick serve`` on this machine.

    As the last line of a cell it shows the page there. Outside of notebooks it opens the browser, if there is a
    desktop, and the result has the ``url``.

    Parameters
    ----------
    source
        An open pyramid, or the path or URL of one; also of a volume, whose pyramid is built into the cache first.
    isovalue
        Of the surface that is shown at first; default: the first suggestion.
    view
        A view as the page and the window save it: its fields, or the path of the file.
    width, height
        Of the page in the cell: pixels, or a text such as ``"100%"``.
    memory, threads
        Of the server; by default the pyramid's, or 1 GiB, and all cores.
    origin
        Where the notebook is, if this process does not know it: ``"https://hub.example.org"``. Also taken from
        ``ISOBRICK_ORIGIN``.
    proxy
        Whether the page comes by jupyter-server-proxy, which it does by default where that is installed and on a
        JupyterHub; or the path of another proxy: ``"/user/me/proxy/{port}/"``.
    browser
        False: no browser is opened.

    Returns
    -------
    BrowserView
        Keep it as long as the page is to work; a notebook keeps results of cells, and isobrick those in browsers.

    Raises
    ------
    Error
        If there is no file, no command ``isobrick``, or no page in it.
    """
    program = str(executable())
    words: list[str] = []
    if isinstance(source, Pyramid):
        path = source.path
        bytes_ = source._memory_bytes
        if source._cache_bytes:
            words += ["--cache-folder", source._cache_folder, "--cache-size", str(source._cache_bytes)]
    else:
        path, bytes_ = _whole_path(os.fspath(source)), byte_size(DEFAULT_MEMORY)
    words += ["--memory", str(byte_size(memory) if memory is not None else bytes_)]
    if threads:
        words += ["--threads", str(threads)]
    in_notebook = _in_notebook()
    notebook = _Notebook(origin, proxy) if in_notebook else None
    for one in notebook.origins if notebook else []:
        words += ["--origin", one]
    key = (program, path, *words)
    server = _servers.get(key)
    if server is None or not server.is_running():
        shown, urls = without_urls([path])
        server = _servers[key] = _PageServer([program, "serve", *shown, *words], urls)
    result = BrowserView(server, _fragment_of(server.key, isovalue, view), notebook, (str(width), str(height)))
    has_desktop = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))
    if not in_notebook:
        _opened.append(result)
        if browser and has_desktop:
            webbrowser.open(result.url)
    return result
