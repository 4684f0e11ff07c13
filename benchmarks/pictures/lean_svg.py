# SPDX-License-Identifier: MIT
"""Makes matplotlib's SVG small: what a screen cannot show is left out.

One file serves light and dark pages: each colour is an attribute, in the light theme,
and a style sheet overrides it where the page is dark. Viewers that know no style sheets
show the light theme, on its own background.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from xml.etree import ElementTree
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from imud.rotation import FloatArray

# The README shows 720 units 830 to 960 pixels wide. A line moves by less than a
# seventh of a pixel, so that no peak is lost.
TOLERANCE = 0.1
PER_UNIT = 100  # coordinates are rounded to 1/100

_SVG = "{http://www.w3.org/2000/svg}"
_HREF = "{http://www.w3.org/1999/xlink}href"
_POINTS = {"M": 1, "L": 1, "Q": 2, "C": 3}  # of each command of a path
_COMMANDS = (*_POINTS, "z")
_PART = re.compile(r"[MLQCz]|-?[\d.]+")
_DECIMALS = re.compile(r"-?\d+\.\d{3,}")
_FONTS = ("font-family", "font-size")


def lean(svg: str, ground: str, dark: Mapping[str, str]) -> str:
    """The same picture on its own ground; `dark`: each light colour's dark one."""
    root = ElementTree.fromstring(svg)  # noqa: S314 - it is matplotlib's
    writer = _Writer(root)
    body = [
        *writer.defs(),
        _tag("rect", {"width": "100%", "height": "100%", "fill": ground}),
        *(line for child in root for line in writer.lines(child)),
    ]
    head = {
        "xmlns": "http://www.w3.org/2000/svg",
        **{name: root.attrib[name] for name in ("width", "height", "viewBox")},
        "stroke-linejoin": "round",
        **writer.fonts,
    }
    rules = "".join(
        f'[{name}="{light}"]{{{name}:{other}}}'
        for light, other in dark.items()
        for name in ("fill", "stroke")
        if any(f'{name}="{light}"' in line for line in body)
    )
    style = f"<style>@media (prefers-color-scheme:dark){{{rules}}}</style>"
    return "\n".join([_tag("svg", head, end=">"), style, *body, "</svg>"]) + "\n"


def thinned(points: FloatArray) -> FloatArray:
    """Some of the points; their line is within TOLERANCE of all (Douglas-Peucker)."""
    kept = np.zeros(len(points), dtype=bool)
    kept[[0, -1]] = True
    stretches = [(0, len(points) - 1)]
    while stretches:
        first, last = stretches.pop()
        if last - first < 2:
            continue
        gaps = _gaps(points[first + 1 : last], points[first], points[last])
        if gaps.max() > TOLERANCE:
            middle = first + 1 + int(gaps.argmax())
            kept[middle] = True
            stretches += [(first, middle), (middle, last)]
    return points[kept]


def _gaps(points: FloatArray, start: FloatArray, end: FloatArray) -> FloatArray:
    """How far points lie from a straight stretch."""
    along = end - start
    squared = float(along @ along)
    share = (points - start) @ along / squared if squared else np.zeros(len(points))
    on_line = start + np.clip(share, 0.0, 1.0)[:, None] * along
    return np.asarray(np.hypot(*(points - on_line).T))


def lean_path(data: str) -> str:
    """Path data with lines thinned, coordinates rounded and relative to the last."""
    written = ""
    at = begun = np.zeros(2, dtype=np.int64)
    for command, points in _runs(data):
        written += command.lower()
        if command == "z":
            at = begun
            continue
        steps = []
        size = _POINTS[command]
        for each in np.rint(points * PER_UNIT).astype(np.int64).reshape(-1, size, 2):
            steps += [f"{value / PER_UNIT:g}" for value in (each - at).ravel()]
            at = each[-1]
        written += " ".join(steps)
        begun = at if command == "M" else begun
    return written


def _runs(data: str) -> Iterator[tuple[str, FloatArray]]:
    """Each command, once for a run of it, with all its points; lines are thinned."""
    runs: list[tuple[str, list[float]]] = []
    for part in _PART.findall(data):
        if part not in _COMMANDS:
            runs[-1][1].append(float(part))
        elif part in "Mz" or part != runs[-1][0]:
            runs.append((part, []))
    start = np.zeros((1, 2))
    for command, values in runs:
        points = np.array(values).reshape(-1, 2)
        if command == "L":
            points = thinned(np.vstack([start, points]))[1:]
        yield command, points
        start = points[-1:] if len(points) else start


class _Writer:
    """Writes elements a line each, and once what several of them refer to."""

    def __init__(self, root: ElementTree.Element) -> None:
        texts = [_styled(text).items() for text in root.iter(f"{_SVG}text")]
        fonts = Counter(each for text in texts for each in text if each[0] in _FONTS)
        # The commonest last, which a dict keeps.
        self.fonts = dict(each for each, _ in reversed(fonts.most_common()))
        self._shared: dict[tuple[str, str], str] = {}
        self._short: dict[str, str] = {}
        for defs in root.iter(f"{_SVG}defs"):
            for each in defs:
                if each.tag != f"{_SVG}style":
                    self._share(each)

    def _share(self, element: ElementTree.Element) -> None:
        """Give an element a short name, the same to equal ones."""
        name = _name(element)
        inside = "".join(_tag(_name(each), self._seen(each)) for each in element)
        rest = _written(self._seen(element)) + (
            f">{inside}</{name}>" if inside else "/>"
        )
        short = f"{name[0]}{len(self._shared)}"
        short = self._shared.setdefault((name, rest), short)
        self._short[element.attrib["id"]] = short

    def defs(self) -> Iterator[str]:
        """The elements that others refer to."""
        yield "<defs>"
        for (name, rest), short in self._shared.items():
            yield f'<{name} id="{short}"{rest}'
        yield "</defs>"

    def lines(self, element: ElementTree.Element) -> Iterator[str]:
        """An element and what is in it."""
        name = _name(element)
        if name == "g":
            yield from self._group(element)
        elif name == "text":
            yield self._text(element)
        elif name in ("path", "use"):
            attributes = self._seen(element)
            if attributes.get("fill") != "none" or "stroke" in attributes:
                yield _tag(name, attributes)
        elif name not in ("defs", "metadata"):
            raise ValueError(f"no rule for <{name}>")

    def _group(self, group: ElementTree.Element) -> Iterator[str]:
        attributes = self._seen(group)
        body = [line for child in group for line in self.lines(child)]
        if attributes and body:
            body = [_tag("g", attributes, end=">"), *body, "</g>"]
        yield from body

    def _text(self, text: ElementTree.Element) -> str:
        if len(text):
            raise ValueError("math text is many elements a letter: use plain text")
        attributes = self._seen(text)
        if attributes.get("transform", "").startswith("rotate(-0 "):
            del attributes["transform"]
        kept = {
            name: value
            for name, value in attributes.items()
            if self.fonts.get(name) != value
        }
        return _tag("text", kept, end=">") + escape(text.text or "") + "</text>"

    def _seen(self, element: ElementTree.Element) -> dict[str, str]:
        """The attributes of an element, and of its style, that change the picture."""
        seen = {}
        for name, value in (element.attrib | _styled(element)).items():
            if name == "d":
                seen[name] = lean_path(value)
            elif name == _HREF:
                seen["href"] = f"#{self._short[value[1:]]}"
            elif name == "clip-path":
                seen[name] = f"url(#{self._short[value[5:-1]]})"
            elif name not in ("id", "style"):
                seen[name] = _DECIMALS.sub(_rounded, value)
        return seen


def _name(element: ElementTree.Element) -> str:
    return element.tag.removeprefix(_SVG)


def _styled(element: ElementTree.Element) -> dict[str, str]:
    """The properties of a style, of which each is an attribute, too."""
    pairs = (each.split(":") for each in element.get("style", "").split(";") if each)
    return {name.strip(): value.strip() for name, value in pairs}


def _rounded(number: re.Match[str]) -> str:
    return f"{round(float(number[0]), 2):g}"


def _tag(name: str, attributes: Mapping[str, str], end: str = "/>") -> str:
    return f"<{name}{_written(attributes)}{end}"


def _written(attributes: Mapping[str, str]) -> str:
    return "".join(f" {name}={quoteattr(text)}" for name, text in attributes.items())
