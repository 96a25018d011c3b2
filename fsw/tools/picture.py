"""Reports and pictures of a graph: a lane for each task with its modules in order; feedback is dashed."""

from __future__ import annotations

import json
from fractions import Fraction
from html import escape
from itertools import count, groupby
from typing import TYPE_CHECKING, Any

import msgspec

from fsw.time import text

if TYPE_CHECKING:
    from fsw.graph import Graph

_LINE, _CHAR, _TRACK = 18, 6.7, 9
"""Pixels from line to line of text, of a character of the 11 px fixed-width font, from wire to wire."""
_COLOURS = ("#1f6fb4", "#c2551a", "#2b8a3e", "#8e3f9e", "#9a7400", "#b02a4c")
_STYLE = (
    "text{font:11px 'DejaVu Sans Mono',Menlo,Consolas,monospace;fill:#222}.title{font-weight:bold}.end{text-anchor:end}"
    ".lane{fill:#eef1f6}.box{fill:#fff;stroke:#444}.wire{fill:none;stroke-width:1.3}.back{stroke-dasharray:5 3}"
)


def lanes(graph: Graph) -> list[tuple[str, list[tuple[int, str]]]]:
    """Title of each task, and place and title of its modules."""
    named = [(place, f"{m.name} ({type(m).__name__})") for place, m in enumerate(graph.modules)]
    tasks = groupby(named, key=lambda module: graph.tasks[module[0]])
    return [(f"{t.name}, every {_time(t.period)} from {_time(t.phase)}", list(modules)) for t, modules in tasks]


def _time(t_ns: Any) -> str:
    return text(t_ns) if type(t_ns) in (int, Fraction) else repr(t_ns)


def text_report(graph: Graph) -> str:
    """Tasks, connections and faults, a line for each."""
    lines = [f"{lane}: {', '.join(name for _, name in modules)}" for lane, modules in lanes(graph)]
    lines += [f"{e.source} -> {e.reader}: {e.label}{', delayed' if e.delayed else ''}" for e in graph.edges]
    return "\n".join([*lines, f"faults: {len(graph.faults())}", *map(str, graph.faults())])


def json_report(graph: Graph) -> str:
    """The same for programs."""
    tasks = [(t, [m.name for m in graph.modules if m in t.modules]) for t in dict.fromkeys(graph.tasks)]
    keys = "name", "period_ns", "phase_ns", "modules"
    shown = [dict(zip(keys, (t.name, t.period, t.phase, names), strict=True)) for t, names in tasks]
    found = {"tasks": shown, "edges": graph.edges, "faults": graph.faults()}
    return msgspec.json.format(msgspec.json.encode(found, enc_hook=str), indent=2).decode()


def mermaid(graph: Graph) -> str:
    """A Mermaid flow chart, for Markdown pages."""

    def quoted(words: str) -> str:
        return '"' + "".join(c if c.isalnum() or c in " .,:_()" else f"#{ord(c)};" for c in words) + '"'

    lines = ["flowchart TB"]
    for number, (title, modules) in enumerate(lanes(graph)):
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
    for number, (title, modules) in enumerate(lanes(graph)):
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
    titles = [len(title) for lane, modules in lanes(graph) for title in (lane, *(name for _, name in modules))]
    box = _CHAR * max(titles + inside, default=0) + 16
    room = [_CHAR * max((len(t) for both in ports for t in both[side].values()), default=0) + 24 for side in (0, 1)]

    drawn: list[str] = []
    bands: list[tuple[int, int]] = []
    at: dict[tuple[bool, str], int] = {}  # height of each port's line
    y = 0

    def put(x: float, y: float, words: str, style: str) -> None:
        drawn.extend([f'<text x="{x:g}" y="{y:g}" class="{style}">{escape(words)}</text>'] if words else [])

    for lane, modules in lanes(graph):
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
