"""Pictures of a graph: a lane for each task with its modules in order; feedback is dashed."""

from __future__ import annotations

import json
from html import escape
from itertools import count
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from fsw.graph import Graph

_LINE, _CHAR, _TRACK = 18, 6.7, 9
"""Pixels from line to line of text, of a character of the 11 px fixed-width font, from wire to wire."""
_COLOURS = ("#1f6fb4", "#c2551a", "#2b8a3e", "#8e3f9e", "#9a7400", "#b02a4c")
_STYLE = (
    "text{font:11px 'DejaVu Sans Mono',Menlo,Consolas,monospace;fill:#222}.title{font-weight:bold}.end{text-anchor:end}"
    ".lane{fill:#eef1f6}.box{fill:#fff;stroke:#444}.wire{fill:none;stroke-width:1.3}.back{stroke-dasharray:5 3}"
)


def mermaid(graph: Graph) -> str:
    """A Mermaid flow chart, for Markdown pages."""

    def quoted(words: str) -> str:
        return '"' + "".join(c if c.isalnum() or c in " .,:_()" else f"#{ord(c)};" for c in words) + '"'

    lines = ["flowchart TB"]
    for number, (title, modules) in enumerate(graph.lanes()):
        boxes = [f"    m{place}[{quoted(name)}]" for place, name in modules]
        lines += [f"  subgraph t{number}[{quoted(title)}]", *boxes, "  end"]
    for e in graph.edges:
        lines.append(f"  m{e.places[0]} {'-.->' if e.backward else '-->'}|{quoted(e.label)}| m{e.places[1]}")
    return "\n".join([*lines, ""])


def dot(graph: Graph) -> str:
    """A Graphviz digraph."""

    def label(words: str) -> str:
        return "label=" + json.dumps(words, ensure_ascii=False)

    lines = ["digraph {", "  node [shape=box]"]
    for number, (title, modules) in enumerate(graph.lanes()):
        boxes = [f"    m{place} [{label(name)}]" for place, name in modules]
        lines += [f"  subgraph cluster_{number} {{", f"    {label(title)}", *boxes, "  }"]
    for e in graph.edges:
        style = "dashed" if e.backward else "solid"
        lines.append(f"  m{e.places[0]} -> m{e.places[1]} [{label(e.label)} style={style}]")
    return "\n".join([*lines, "}", ""])


def svg(graph: Graph) -> str:
    """A drawing: forward wires on the right, feedback on the left, each input on a line of its own with its label."""
    ports: list[tuple[dict[str, str], dict[str, str]]] = [({}, {}) for _ in graph.modules]  # right, left; port: label
    wires: dict[tuple[bool, str], list[str]] = {}
    for e in graph.edges:
        ports[e.places[0]][e.backward].setdefault(e.source, "")
        ports[e.places[1]][e.backward][e.reader] = e.label
        wires.setdefault((e.backward, e.source), []).append(e.reader)
    inside = [sum(max(map(len, side), default=0) for side in both) for both in ports]  # with module names: a margin
    titles = [len(title) for lane, modules in graph.lanes() for title in (lane, *(name for _, name in modules))]
    box = _CHAR * max(titles + inside, default=0) + 16
    room = [_CHAR * max((len(t) for both in ports for t in both[side].values()), default=0) + 24 for side in (0, 1)]

    drawn: list[str] = []
    bands: list[tuple[int, int]] = []
    at: dict[tuple[bool, str], int] = {}  # height of each port's line
    y = 0

    def put(x: float, y: float, words: str, style: str) -> None:
        drawn.extend([f'<text x="{x:g}" y="{y:g}" class="{style}">{escape(words)}</text>'] if words else [])

    for lane, modules in graph.lanes():
        put(0, y + 16, lane, "title")
        top, y = y, y + 24
        for place, name in modules:
            height = _LINE * (1 + max(map(len, ports[place]))) + 4
            drawn.append(f'<rect class="box" y="{y}" width="{box:g}" height="{height}"/>')
            put(8, y + 14, name, "title")
            for back, x, out, inward, outward in ((False, box, 1, "end", "start"), (True, 0, -1, "start", "end")):
                for line, (port, label) in enumerate(ports[place][back].items()):
                    at[back, port] = level = y + _LINE * line + 32
                    put(x - 6 * out, level + 4, port.partition(".")[2], inward)
                    put(x + 12 * out, level - 4, label, outward)
            y += height + 10
        bands.append((top, y - top))
        y += 8

    taken: dict[tuple[bool, int], list[tuple[int, int]]] = {}  # heights that wires use, of each track from the boxes
    spans = {w: sorted(at[w[0], port] for port in (w[1], *readers)) for w, readers in wires.items()}
    for number, wire in enumerate(sorted(wires, key=lambda w: spans[w][-1] - spans[w][0])):
        back, first, last = wire[0], spans[wire][0], spans[wire][-1]
        track = next(n for n in count() if all(b < first or last < a for a, b in taken.get((back, n), ())))
        taken.setdefault((back, track), []).append((first, last))
        x, out = (0, -1) if back else (box, 1)
        turn, colour = x + out * (room[back] + _TRACK * track), _COLOURS[number % len(_COLOURS)]
        for end in [at[back, reader] for reader in wires[wire]]:
            way = f"M{x:g} {at[wire]}H{turn:g}V{end}H{x + 6 * out:g}"
            drawn.append(f'<path class="wire{" back" * back}" d="{way}" stroke="{colour}"/>')
            drawn.append(f'<path d="M{x:g} {end}l{8 * out} -4v8z" fill="{colour}"/>')

    right, left = (16 + room[i] + _TRACK * sum(back == i for back, _ in taken) for i in (0, 1))
    width = f'width="{left + box + right:g}"'
    view = f'viewBox="{-left:g} 0 {left + box + right:g} {y}" {width} height="{y}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {view}><style>{_STYLE}</style>'
    behind = [f'<rect class="lane" x="{-left:g}" y="{top}" {width} height="{height}"/>' for top, height in bands]
    return "\n".join([head, *behind, *drawn, "</svg>", ""])
