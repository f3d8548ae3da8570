"""Pages of the site that are made of something else: the options of the command, CONTRIBUTING.md and CHANGELOG.md."""

from __future__ import annotations

import html
import json
import os
import subprocess
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]


def definitions() -> dict[str, Any]:
    """The commands and their options, each from the executable that has it."""
    isobrick = os.environ["ISOBRICK"]

    def of(executable: str) -> dict[str, Any]:
        done = subprocess.run([executable, "definitions"], capture_output=True, text=True, check=True)
        return json.loads(done.stdout)

    result = of(isobrick)
    for other in ("isobrick-build", "isobrick-view"):
        beside = Path(isobrick).with_name(other)
        if beside.exists():
            theirs = {command["name"]: command for command in of(str(beside))["commands"]}
            result["commands"] = [theirs.get(command["name"], command) for command in result["commands"]]
    return result


def text(words: str) -> str:
    """As it is, in a table of Markdown."""
    return html.escape(words, quote=False).replace("|", "&#124;").replace("*", "&#42;").replace("_", "&#95;")


def options_page() -> str:
    """One section a command, one table a group of its options."""
    every = definitions()
    lines = [
        "# Options",
        "",
        "This page lists every command with its options, as the command itself defines them; `isobrick COMMAND",
        "--help` and `man isobrick-COMMAND` say the same.",
        "",
        "| command | |",
        "|---|---|",
    ]
    lines += [f"| [`{c['name']}`](#{c['name']}) | {text(c['description'])} |" for c in every["commands"]]
    for command in every["commands"]:
        lines += ["", f"## {command['name']}", "", text(command["description"]) + "."]
        inputs = "".join(f" {o['positional']}" for o in command["options"] if o["positional"])
        lines += ["", f"```text\nisobrick {command['name']} [OPTIONS]{inputs}\n```"]
        groups: dict[str, list[str]] = {}
        for option in sorted(command["options"], key=lambda option: not option["positional"]):
            if "--help" in option["names"]:
                continue
            names = ", ".join(f"`{name}`" for name in option["names"]) or f"`{option['positional']}`"
            value = f" {text(option['value'])}" if option["value"] else ""
            group = "Arguments" if option["positional"] else option["group"]
            groups.setdefault(group, []).append(f"| {names}{value} | {text(option['description'])} |")
        for group, rows in groups.items():
            lines += ["", f"**{group}**", "", "| option | |", "|---|---|", *rows]
        if command["footer"].strip():
            lines += ["", f"```text\n{command['footer'].strip()}\n```"]
    return "\n".join(lines) + "\n"


def from_the_root(name: str) -> str:
    """A page of the root, its links as from docs/explanation/."""
    page = (ROOT / name).read_text()
    return page.replace("](docs/", "](../")


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links of docs/*/ to pages of the root lead to their copies."""
    for name, copy in (("CONTRIBUTING.md", "contributing.md"), ("CHANGELOG.md", "changes.md")):
        markdown = markdown.replace(f"](../../{name})", f"](../explanation/{copy})")
    return markdown


def on_files(files: Files, config: MkDocsConfig) -> Files:
    files.append(File.generated(config, "reference/options.md", content=options_page()))
    files.append(File.generated(config, "explanation/contributing.md", content=from_the_root("CONTRIBUTING.md")))
    files.append(File.generated(config, "explanation/changes.md", content=from_the_root("CHANGELOG.md")))
    return files
