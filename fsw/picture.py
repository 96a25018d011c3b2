"""Pictures of a graph: one lane for each task, its modules in order; feedback is dashed."""

from __future__ import annotations

import json
from html import escape
from itertools import groupby
from typing import TYPE_CHECKING

from fsw.time import text

if TYPE_CHECKING:
    from fsw.graph import Graph

_LINE, _CHAR, _TRACK = 18, 6.7, 9
"""Pixels from line to line of text, of a character of the 11 px fixed-width font, from wire to wire."""
_COLOURS = ("#1f6fb4", "#c2551a", "#2b8a3e", "#8e3f9e", "#9a7400", "#b02a4c")
_STYLE = (
    "text{font:11px 'DejaVu Sans Mono',Menlo,Consolas,monospace;fill:#222}.b{font-weight:bold}.l{fill:#555}.e{text-anchor:end}"
    ".lane{fill:#f3f5f8}.box{fill:#fff;stroke:#444}.wire{fill:none;stroke-width:1.4}.back{stroke-dasharray:5 3}"
)


def _lanes(graph: Graph) -> list[tuple[str, list[tuple[int, str, str]]]]:
    """Each task's title and its modules: place, name, class."""
    named = [(i, m.name, type(m).__name__) for i, m in enumerate(graph.modules)]
    runs = groupby(named, key=lambda module: graph.tasks[module[0]])
    return [(f"{t.name}: every {text(t.period)} from {text(t.phase)}", list(modules)) for t, modules in runs]


def mermaid(graph: Graph) -> str:
    """A Mermaid flow chart, for Markdown pages."""

    def quoted(words: str) -> str:
        return '"' + "".join(c if c.isalnum() or c in " .,:_()" else f"#{ord(c)};" for c in words) + '"'

    lines = ["flowchart TB"]
    for number, (title, modules) in enumerate(_lanes(graph)):
        boxes = [f"    m{place}[{quoted(f'{name} ({kind})')}]" for place, name, kind in modules]
        lines += [f"  subgraph t{number}[{quoted(title)}]", *boxes, "  end"]
    for e in graph.edges:
        lines.append(f"  m{e.places[0]} {'-.->' if e.backward else '-->'}|{quoted(e.label)}| m{e.places[1]}")
    return "\n".join(lines) + "\n"


def dot(graph: Graph) -> str:
    """A Graphviz digraph."""
    lines = ["digraph {", "  node [shape=box]"]
    for number, (title, modules) in enumerate(_lanes(graph)):
        boxes = [f"    m{p} [label={json.dumps(f'{n} ({k})', ensure_ascii=False)}]" for p, n, k in modules]
        lines += [f"  subgraph cluster_{number} {{", f"    label={json.dumps(title, ensure_ascii=False)}", *boxes, "  }"]
    for e in graph.edges:
        style = ", style=dashed" if e.backward else ""
        lines.append(f"  m{e.places[0]} -> m{e.places[1]} [label={json.dumps(e.label, ensure_ascii=False)}{style}]")
    return "\n".join([*lines, "}", ""])


def svg(graph: Graph) -> str:
    """A drawing: forward wires on the right, feedback on the left, every input on its own line with its label."""
    sides: list[list[dict[str, str]]] = [[{}, {}] for _ in graph.modules]  # of each module: right and left, port: label
    for e in graph.edges:
        sides[e.places[0]][e.backward].setdefault(e.source, "")
        sides[e.places[1]][e.backward][e.reader] = e.label
    y, at, lanes, boxes = 0, {}, [], []
    at: dict[tuple[bool, str], int] = {}
    return ""
