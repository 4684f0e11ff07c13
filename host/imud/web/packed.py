# SPDX-License-Identifier: MIT
"""The page in one file, for where no daemon is: a folder, a USB stick, a site.

Browsers load no modules from a file, so they become one script, each in a function of
its own after those that it imports. A policy in the file allows this script and this
style by their hashes, and no connection to anybody.
"""

from __future__ import annotations

import base64
import hashlib
import html
import re
import shutil
from pathlib import Path
from urllib.parse import urljoin

from imud import packaged
from imud.errors import FileError
from imud.version import version
from imud.web.files import HERE, Files

PICO = "pico.uf2"
LIBRARIES = ("three", "uplot")

_IMPORT = re.compile(
    r'^import (?:(\w+)|\* as (\w+)|\{([^}]*)\}) from "([^"]+)";\n', re.MULTILINE
)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|class|const) (\w+))", re.M)
_LIST = re.compile(r"export\s*\{([^}]*)\};?\s*\Z")
_STYLE = re.compile(r' *<link rel="stylesheet" href="([^"]+)" />\n')
_SCRIPT = re.compile(r' *<(?:link rel="modulepreload"|script) .*\n')

_ABOUT = "This page needs JavaScript."


class Bundle:
    """The modules in the order in which they run."""

    def __init__(self, files: Files) -> None:
        self._files = files
        self._names: dict[str, str] = {}
        self.text = ""

    def add(self, url: str) -> str:
        """The name of the object with what a module exports. None imports itself by way
        of others: RecursionError.
        """
        if url not in self._names:
            text = text_of(self._files, url)
            code = _IMPORT.sub(lambda found: self._taken(url, found), text)
            exported = [(name, name) for name in _EXPORT.findall(code)]
            code = _EXPORT.sub("", code)
            if listed := _LIST.search(code):
                code = code[: listed.start()]
                for each in listed[1].split(","):
                    name, _, called = each.strip().partition(" as ")
                    exported.append((called or name, name))
            self._names[url] = name = f"module{len(self._names)}"
            given = ", ".join(f"{called}: {name}" for called, name in exported)
            body = f"{code}\nreturn {{ {given} }};"
            self.text += f"const {name} = (() => {{\n{body}\n}})();\n"
        return self._names[url]

    def _taken(self, url: str, found: re.Match[str]) -> str:
        default, everything, names, path = found.groups()
        module = self.add(urljoin(url, path))
        if everything:
            return f"const {everything} = {module};\n"
        taken = f"default: {default}" if default else names.replace(" as ", ": ")
        return f"const {{ {taken} }} = {module};\n"


def text_of(files: Files, url: str) -> str:
    file = files.get(url)
    if file is None:
        raise LookupError(f"the page has no {url}")
    return file.body.decode("utf-8")


def page(pico: str = "") -> str:
    """The text of the file. `pico`: the name of an image beside it."""
    files = Files()
    bundle = Bundle(files)
    bundle.add("/main.js")
    text = text_of(files, "/")
    style = "".join(text_of(files, url) for url in _STYLE.findall(text))
    icon = base64.b64encode(text_of(files, "/icon.svg").encode()).decode()
    icon = f"data:image/svg+xml;base64,{icon}"
    script = f'"use strict";\n{bundle.text}'.replace("/icon.svg", icon)
    script = script.replace("</script", r"<\/script")
    policy = "; ".join(
        (
            "default-src 'none'",
            f"script-src {_hash(script)}",
            f"style-src {_hash(style)}",
            "img-src data: blob:",
            "base-uri 'none'",
            "form-action 'none'",
        )
    )
    about = f'data-daemon="none" data-version="{html.escape(version())}"'
    about += f' data-pico="{pico}"' if pico else ""
    text = _SCRIPT.sub("", _STYLE.sub("", text)).replace("/icon.svg", icon)
    text = text.replace('<html lang="en">', f'<html lang="en" {about}>')
    text = re.sub("<noscript>.*</noscript>", f"<noscript>{_ABOUT}</noscript>", text)
    head = f'<meta http-equiv="Content-Security-Policy" content="{policy}" />'
    text = text.replace("</title>", f"</title>\n    {head}\n<style>{style}</style>")
    return text.replace("</body>", f"<script>{script}</script>\n  </body>")


def _hash(text: str) -> str:
    digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return f"'sha256-{digest}'"


def write(folder: Path) -> list[Path]:
    """Writes the page into a folder, with its licences, and with the Pico's firmware
    where that is installed. FileError if another page is there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    there = folder / "index.html"
    if there.exists() and b'data-daemon="none"' not in there.read_bytes():
        raise FileError(f"{there} is another page; choose another folder")
    images = packaged.folder_of(packaged.FIRMWARE)
    image = images / PICO if images is not None else None
    made = [folder / "index.html", folder / "LICENSES.txt"]
    if image is not None and image.exists():
        made.append(Path(shutil.copy(image, folder)))
    made[0].write_text(page(PICO if len(made) > 2 else ""), "utf-8")
    licences = [
        f"{name}\n\n{(HERE / 'vendor' / name / 'LICENSE').read_text('utf-8')}"
        for name in LIBRARIES
    ]
    made[1].write_text("\n\n".join(licences), "utf-8")
    return made
