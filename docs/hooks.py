"""Pages of the site that are made of something else: the options of the command, CONTRIBUTING.md and CHANGELOG.md."""

from __future__ import annotations

import html
import os
import re
import subprocess
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

COPIES = {"CONTRIBUTING.md": "explanation/contributing.md", "CHANGELOG.md": "explanation/changes.md"}


def help_of(*words: str) -> list[str]:
    """Its lines: names and text of an item in two columns, or with a tab between them if the names are long."""
    done = subprocess.run([os.environ["ISOBRICK"], *words, "--help"], capture_output=True, text=True, check=True)
    return re.sub(r"\n {38}", "\t", done.stdout).splitlines()


def row(line: str) -> str:
    names, text = line.split("\t") if "\t" in line else (line[:38], line[38:])
    names, *value = re.sub(r" (Needs|Excludes):.*| REQUIRED|:?{[^}]*}", "", names).strip().split(" ", 1)
    words = html.escape(" ".join(value), quote=False), html.escape(text, quote=False)
    named = ", ".join(f"`{name}`" for name in names.split(","))
    return "| {} {} | {} |".format(named, *(re.sub(r"[|*_]", lambda c: f"&#{ord(c[0])};", word) for word in words))


def section(command: str) -> list[str]:
    """A table for each group of options, and the rest of the help as it is."""
    description, usage, *lines = help_of(command)
    result = ["", f"## {command}", "", f"{description}.", "", f"```text\n{usage.removeprefix('Usage: ')}\n```"]
    for number, line in enumerate(lines):
        if re.match(r"Examples?:|\S.*[^:]$", line):
            return [*result, "", "```text", *lines[number:], "```"]
        if line.startswith("  "):
            result.append(row(line))
        elif line:
            result += ["", f"**{line.rstrip(':')}**", "", "| option | |", "|---|---|"]
    return result


def options_page() -> str:
    lines = ["# Options", "", "Every command with its options, as `isobrick COMMAND --help` and `man isobrick-COMMAND` have them."]
    for line in help_of():
        if command := re.match(r"  ([a-z]+)  ", line):
            lines += section(command[1])
    return "\n".join(lines) + "\n"


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links to pages of the repository's root lead to their copies."""
    for name, copy in COPIES.items():
        markdown = markdown.replace(f"](../../{name})", f"](../{copy})").replace(f"](../{name})", f"]({copy})")
    return markdown


def on_files(files: Files, config: MkDocsConfig) -> Files:
    files.append(File.generated(config, "reference/options.md", content=options_page()))
    for name, copy in COPIES.items():
        page = (Path(config.docs_dir).parent / name).read_text()
        files.append(File.generated(config, copy, content=page.replace("](docs/", "](../")))
    return files
