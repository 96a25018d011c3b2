"""Pictures of a graph: every module and connection is there, names are escaped, nothing lies on anything else."""

from __future__ import annotations

import re
from itertools import combinations
from typing import Annotated, Any
from xml.etree import ElementTree as ET

import pytest

from fsw import In, Message, Module, Out, Task, ms, s
from fsw.graph import Graph

TRICKY = 'a<b> & "c" \\ d#1|'
SVG = "{http://www.w3.org/2000/svg}"


class ValueMsg(Message):
    """A number."""

    x: Annotated[float, "-", "number"] = 0.0


class Node(Module):
    in_first = In(ValueMsg, optional=True)
    in_second_value = In(ValueMsg, optional=True)
    out_value = Out(ValueMsg)
    out_rest = Out(ValueMsg)

    def step(self, t_ns: int) -> None:
        self.out_value.write(ValueMsg(), t_ns)


def ten_modules() -> Graph:
    """Three tasks, forward and feedback connections, one output with several readers, awkward names."""
    names = [TRICKY, *(f"module_{i}" for i in range(1, 10))]
    nodes = [Node(name) for name in names]
    wires = [(0, 1), (0, 2), (0, 9), (1, 4), (2, 5), (4, 6), (9, 0), (8, 3), (5, 8)]
    for writer, reader in wires:
        nodes[writer].out_value.connect(nodes[reader].in_first, delayed=reader < writer)
    for writer, reader in [(3, 7), (7, 8), (6, 1)]:
        nodes[writer].out_rest.connect(nodes[reader].in_second_value, delayed=reader < writer)
    tasks = [
        Task("truth & sensors", ms(100), nodes[:3]),
        Task("nav", s(1), nodes[3:8], phase=s(0.5)),
        Task("log", s(10), nodes[8:]),
    ]
    graph = Graph(tasks)
    assert graph.faults() == []
    assert len(graph.edges) == 12
    return graph


def words(element: ET.Element) -> str:
    return element.text or ""


def extent(text: ET.Element) -> tuple[float, float, float, float]:
    """Left, right, top, bottom of a text of 11 px in a font whose characters are 0.602 em wide."""
    x, y, width = float(text.attrib["x"]), float(text.attrib["y"]), 0.602 * 11 * len(words(text))
    left = x - width if text.attrib["class"] == "end" else x
    return left, left + width, y - 8, y + 2


def wire_lines(root: ET.Element) -> list[tuple[float, float, float, float]]:
    """The straight pieces of all wires: left, right, top, bottom."""
    lines: list[tuple[float, float, float, float]] = []
    for path in [p for p in root.iter(f"{SVG}path") if "wire" in p.attrib.get("class", "")]:
        found = re.fullmatch(r"M(\S+) (\S+)H(\S+)V(\S+)H(\S+)", path.attrib["d"])
        assert found
        x0, y0, turn, y1, x1 = map(float, found.groups())
        for a, b, c, d in ((x0, turn, y0, y0), (turn, turn, y0, y1), (turn, x1, y1, y1)):
            lines.append((min(a, b), max(a, b), min(c, d), max(c, d)))
    return lines


def overlap(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    return a[0] < b[1] and b[0] < a[1] and a[2] < b[3] and b[2] < a[3]


def test_svg_shows_every_module_and_connection() -> None:
    graph = ten_modules()
    root = ET.fromstring(graph.picture("svg"))
    texts = [words(t) for t in root.iter(f"{SVG}text")]
    for module in graph.modules:
        assert f"{module.name} (Node)" in texts
    for title in ("truth & sensors, every 0.1 s from 0 s", "nav, every 1 s from 0.5 s", "log, every 10 s from 0 s"):
        assert title in texts
    for label in {e.label for e in graph.edges}:
        assert texts.count(label) == [e.label for e in graph.edges].count(label)
    classes = [p.attrib.get("class", "") for p in root.iter(f"{SVG}path")]
    assert classes.count("wire back") == sum(e.backward for e in graph.edges) == 3
    assert classes.count("wire") == 9
    assert [r.attrib["class"] for r in root.iter(f"{SVG}rect")].count("lane") == 3


def test_svg_has_no_overlaps() -> None:
    root = ET.fromstring(ten_modules().picture("svg"))
    texts = [t for t in root.iter(f"{SVG}text") if words(t)]
    boxes = [r for r in root.iter(f"{SVG}rect") if r.attrib["class"] == "box"]
    left, top, width, height = map(float, root.attrib["viewBox"].split())
    for one, two in combinations(texts, 2):
        assert not overlap(extent(one), extent(two)), (one.text, two.text)
    lines = wire_lines(root)
    for text in texts:
        around = extent(text)
        assert left < around[0]
        assert around[1] < left + width
        assert top < around[2]
        assert around[3] < top + height
        assert not any(overlap(around, (a - 0.1, b + 0.1, c - 0.1, d + 0.1)) for a, b, c, d in lines), text.text
    frames = [
        (0.0, float(b.attrib["width"]), float(b.attrib["y"]), float(b.attrib["y"]) + float(b.attrib["height"]))
        for b in boxes
    ]
    assert not any(overlap(a, b) for a, b in combinations(frames, 2))
    assert not any(overlap(frame, (a + 0.1, b - 0.1, c - 0.1, d + 0.1)) for frame in frames for a, b, c, d in lines)
    vertical = [line for line in lines if line[0] == line[1] and line[2] < line[3]]
    by_track: dict[float, list[tuple[float, float]]] = {}
    for x, _, upper, lower in vertical:
        by_track.setdefault(x, []).append((upper, lower))
    for spans in by_track.values():  # on one track, wires of one source begin at one height, others keep apart
        for (a, b), (c, d) in combinations(spans, 2):
            assert b < c or d < a or a == c or b == d


def test_mermaid_is_well_formed() -> None:
    graph = ten_modules()
    lines = graph.picture("mermaid").splitlines()
    assert lines[0] == "flowchart TB"
    text = r'"[\w .,:()#;]*"'
    patterns = (rf"  subgraph t\d\[{text}\]", rf"    m\d\[{text}\]", "  end", rf"  m\d (-->|-\.->)\|{text}\| m\d")
    assert all(any(re.fullmatch(p, line) for p in patterns) for line in lines[1:])
    assert [sum(bool(re.fullmatch(p, line)) for line in lines) for p in patterns] == [3, 10, 3, 12]
    assert sum("-.->" in line for line in lines) == 3
    name = next(line for line in lines if line.startswith("    m0"))
    assert re.sub(r"#(\d+);", lambda m: chr(int(m[1])), name) == f'    m0["{TRICKY} (Node)"]'


def test_dot_is_well_formed() -> None:
    graph = ten_modules()
    lines = graph.picture("dot").splitlines()
    text = r'"(?:[^"\\]|\\.)*"'
    assert lines[0] == "digraph {"
    assert lines[-1] == "}"
    assert sum(bool(re.fullmatch(rf"    m\d \[label={text}\]", line)) for line in lines) == 10
    wires = [line for line in lines if re.fullmatch(rf"  m\d -> m\d \[label={text} style=(solid|dashed)\]", line)]
    assert len(wires) == 12
    assert sum(line.endswith("style=dashed]") for line in wires) == 3
    assert sum("subgraph cluster_" in line for line in lines) == 3
    assert r'"a<b> & \"c\" \\ d#1| (Node)"' in lines[4]


@pytest.mark.parametrize("form", ["svg", "dot", "mermaid"])
def test_graph_without_connections_or_modules_is_drawn(form: Any) -> None:
    assert "alone" in Graph([Task("t", s(1), [Node("alone")])]).picture(form)
    assert Graph([]).picture(form)
