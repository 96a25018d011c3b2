"""The command line ``fsw``: exit code 0 is well, 1 faults or a failed run, 2 a command or input that is not usable."""

from __future__ import annotations

import argparse
import difflib
import functools
import importlib
import importlib.metadata
import importlib.util
import inspect
import json
import os
import pkgutil
import platform
import runpy
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
from rich.console import Console
from rich.markup import escape
from rich.progress import track
from rich.table import Table

import messages
from fsw import cache, compiler
from fsw.files import atomic
from fsw.graph import Graph
from fsw.math.compiled import COMPILE
from fsw.module import KernelModule
from fsw.ports import collect_wiring_errors
from fsw.simulation import Simulation
from fsw.tools import filters, fit_orbit, limb, scaffold, specs, vision
from messages.base import Message, ObjectMessage, fields_of, json_schema

SCENARIO = "a module such as sim.scenarios.hill_pointing, or a .py file"


class UsageError(Exception):
    """What was asked for cannot be done; the text says why and what to do."""


def locate(scenario: str) -> None:
    """Check that a scenario exists."""
    try:
        found = Path(scenario).is_file() if scenario.endswith(".py") else importlib.util.find_spec(scenario)
    except (ImportError, ValueError):
        found = None
    if not found:
        raise UsageError(f"there is no scenario {scenario}; give {SCENARIO}, from the folder that holds it")


def build(scenario: str) -> tuple[Simulation, Graph]:
    """The simulation that the scenario's ``build()`` returns, and its graph with all wiring faults."""
    locate(scenario)
    if scenario.endswith(".py"):
        spec = importlib.util.spec_from_file_location(f"scenario_{Path(scenario).stem}", scenario)
        assert spec is not None and spec.loader is not None
        module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    else:
        module = importlib.import_module(scenario)
    maker = getattr(module, "build", None)
    if maker is None:
        raise UsageError(f"{scenario} has no function build() that returns its Simulation; write one")
    parameters = inspect.signature(maker).parameters.values()
    if required := [
        p.name for p in parameters if p.default is p.empty and p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)
    ]:
        raise UsageError(f"build() of {scenario} needs {', '.join(required)}; give these arguments defaults")
    with collect_wiring_errors() as collected:
        made = maker()
    sim = getattr(made, "sim", made)
    if not isinstance(sim, Simulation):
        raise UsageError(f"build() of {scenario} returned {made!r}; expected a Simulation or an object with .sim")
    return sim, Graph(sim.tasks, collected, sim)


def root_folder() -> Path:
    """The repository that holds the current folder."""
    for folder in (Path.cwd(), *Path.cwd().parents):
        if all((folder / name).exists() for name in ("pyproject.toml", "modules", "sim", "tests")):
            sys.path.insert(0, str(folder))  # its modules are the ones to import
            return folder
    raise UsageError("the current folder is not in a repository with modules/, sim/ and tests/; change to its root")


def run(args: argparse.Namespace) -> int:
    """Run a scenario as ``python -m`` does."""
    locate(args.scenario)
    sys.argv = [args.scenario, *args.arguments]
    if args.scenario.endswith(".py"):
        runpy.run_path(args.scenario, run_name="__main__")
    else:
        runpy.run_module(args.scenario, run_name="__main__", alter_sys=True)
    return 0


def graph(args: argparse.Namespace) -> int:
    """Print or save the graph of a scenario."""
    made = build(args.scenario)[1]
    text = made.report(args.format) if args.format in ("text", "json") else made.picture(args.format)
    if args.output is None:
        print(text)
        return 0
    with atomic(args.output) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")
    return 0


def check(args: argparse.Namespace) -> int:
    """List faults of wiring and of specs."""
    found: dict[str, list[Any]] = {}
    for scenario in args.scenarios:
        found[scenario] = build(scenario)[1].faults()
    if args.specs or not args.scenarios:
        found["specs"] = list(specs.check(root_folder()))
    if args.json:
        print(json.dumps(msgspec.to_builtins(found), indent=2))
    else:
        for name, faults in found.items():
            print(f"{name}: {len(faults) or 'no'} fault{'s' * (len(faults) != 1)}")
            for fault in faults:
                print(f"  {fault}")
    return 1 if any(found.values()) else 0


def known_messages() -> dict[str, type[Message | ObjectMessage]]:
    """All message classes declared in the package ``messages``, by name."""
    found = [vars(importlib.import_module(m.name)) for m in pkgutil.iter_modules(messages.__path__, "messages.")]
    kinds = [kind for names in found for kind in names.values() if inspect.isclass(kind)]
    declared = [k for k in kinds if issubclass(k, (Message, ObjectMessage)) and k not in (Message, ObjectMessage)]
    return {k.__name__: k for k in sorted(declared, key=lambda k: k.__name__)}


def dictionary(args: argparse.Namespace) -> int:
    """Print the declared messages."""
    known = known_messages()
    wanted: str | None = args.message
    if wanted is not None and wanted not in known:
        close = difflib.get_close_matches(wanted, known, 3) or list(known)
        raise UsageError(f"there is no message {wanted}; did you mean {', '.join(close)}?")
    chosen = [kind for name, kind in known.items() if wanted in (None, name)]
    if args.schema or args.json:
        print(json.dumps([json_schema(k) for k in chosen] if args.schema else [_entry(k) for k in chosen], indent=2))
        return 0
    console = Console()
    for entry in map(_entry, chosen):
        table = Table("field", "type", "shape", "unit", "description", title_justify="left")
        table.title = f"[bold]{entry['message']}[/bold]  {escape(entry['description'])}"
        for field in entry["fields"]:
            table.add_row(*(escape(str(v)) for v in field.values()))
        console.print(table)
    return 0


def _entry(kind: type[Message | ObjectMessage]) -> dict[str, Any]:
    fields = [
        {"name": f.name, "type": f.kind, "shape": str(f.shape or "-"), "unit": f.unit, "description": f.description}
        for f in fields_of(kind)
    ]
    return {"message": kind.__name__, "description": inspect.cleandoc(kind.__doc__ or ""), "fields": fields}


def new_module(args: argparse.Namespace) -> int:
    """Make a module folder and its test."""
    try:
        made = scaffold.new_module(args.name, root_folder(), "python" if args.python else "kernel")
    except ValueError as error:
        raise UsageError(str(error)) from error
    print(*made, sep="\n")
    print(f"Put your mathematics into kernel.py; test it with: python -m pytest {made[-1]}")
    return 0


def compile_kernels(args: argparse.Namespace) -> int:
    """Compile the kernels of a scenario, or all of the repository, into the cache."""
    if not COMPILE:
        raise UsageError("compilation is switched off by FSW_COMPILE=0; unset it")
    if args.scenario:
        found = [type(m) for m in build(args.scenario)[0].modules]
    else:
        found = [specs.class_of(folder, root) for root in [root_folder()] for folder in specs.module_folders(root)]
    kernels = list(dict.fromkeys(c for c in found if issubclass(c, KernelModule)))
    cache.progress = lambda text: None
    console = Console(stderr=True)
    entries = [compiler.loop_entry(), *(compiler.entry_of(c) for c in track(kernels, "compiling", console=console))]
    fresh = sum(not e.from_cache for e in entries)
    print(f"{len(entries)} compiled, {fresh} of them now, {len(entries) - fresh} earlier; in {cache.cache_folder()}")
    return 0


def usable(action: Callable[[argparse.Namespace], int]) -> Callable[[argparse.Namespace], int]:
    """An action whose ValueErrors are about what it was given."""

    def act(args: argparse.Namespace) -> int:
        try:
            return action(args)
        except ValueError as error:
            raise UsageError(str(error)) from error

    return act


def info(args: argparse.Namespace) -> int:
    """Show versions, cache and sizes."""
    folder = cache.cache_folder()
    size = sum(f.stat().st_size for f in folder.rglob("*") if f.is_file())
    table = Table.grid(padding=(0, 2))
    installed = [d.version for d in importlib.metadata.distributions(name="opnav-fsw")] or ["not installed"]
    table.add_row("fsw", f"{installed[0]}, Python {platform.python_version()}")
    table.add_row("libraries", ", ".join(f"{p} {importlib.metadata.version(p)}" for p in ("numpy", "numba", "msgspec")))
    table.add_row("machine", f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores")
    table.add_row("kernels", "compiled" if COMPILE else "plain Python (FSW_COMPILE=0)")
    table.add_row("cache", f"{folder}, {len(list(folder.glob('*.o')))} kernels, {size / 1e6:.1f} MB")
    try:
        here = f"{len(specs.module_folders(root_folder()))} modules, {len(known_messages())} messages"
    except UsageError as error:
        here = str(error)
    table.add_row("here", here)
    Console(soft_wrap=True).print(table)
    return 0


def parser() -> argparse.ArgumentParser:
    """The arguments of every command, with help."""
    hill = "sim.scenarios.hill_pointing"
    layout: Any = functools.partial(argparse.RawDescriptionHelpFormatter, max_help_position=26)
    shared = argparse.ArgumentParser(add_help=False)
    shared.add_argument(
        "--debug", action="store_true", default=argparse.SUPPRESS, help="show the traceback of an error"
    )
    top = argparse.ArgumentParser(
        prog="fsw",
        parents=[shared],
        description="Compose, check and run simulations of flight software.",
        epilog=f"First steps:\n  fsw run {hill}\n  fsw new-module control/damper\n  fsw COMMAND --help",
        formatter_class=layout,
    )
    commands = top.add_subparsers(metavar="COMMAND", required=True)

    def add(name: str, action: Callable[[argparse.Namespace], int], text: str, example: str) -> argparse.ArgumentParser:
        description, epilog = f"{text[0].upper()}{text[1:]}.", f"Example:  fsw {example}"
        more: dict[str, Any] = {"help": text, "description": description, "epilog": epilog}
        made = commands.add_parser(name, parents=[shared], formatter_class=layout, **more)
        made.set_defaults(action=action)
        return made

    made = add("run", run, "run a scenario with its own options", f"run {hill} --help")
    made.add_argument("scenario", metavar="SCENARIO", help=SCENARIO)
    made.add_argument("arguments", nargs=argparse.REMAINDER, help="options of the scenario")
    made = add("graph", graph, "show which module reads what from which", f"graph {hill} --format svg -o graph.svg")
    made.add_argument("scenario", metavar="SCENARIO", help=SCENARIO)
    made.add_argument(
        "--format", choices=["text", "json", "mermaid", "dot", "svg"], default="text", help="default: text"
    )
    made.add_argument("-o", "--output", type=Path, metavar="FILE", help="write to a file")
    made = add(
        "check", check, "list all wiring faults of scenarios, or all faults of the specs", f"check {hill} --json"
    )
    made.add_argument("scenarios", nargs="*", metavar="SCENARIO", help=f"{SCENARIO}; none: check the specs")
    made.add_argument("--specs", action="store_true", help="check the specs of all modules too")
    made.add_argument("--json", action="store_true", help="print JSON")
    made = add("dictionary", dictionary, "list messages with their fields, units and shapes", "dictionary PoseFixMsg")
    made.add_argument("message", nargs="?", metavar="MESSAGE", help="one message; none: all")
    made.add_argument("--json", action="store_true", help="print JSON")
    made.add_argument("--schema", action="store_true", help="print JSON schemas")
    made = add(
        "new-module", new_module, "make a module folder and its test, both complete", "new-module control/damper"
    )
    made.add_argument("name", metavar="DOMAIN/NAME", help=f"domains: {', '.join(scaffold.DOMAINS)}")
    made.add_argument("--python", action="store_true", help="a Python module instead of a compiled kernel")
    made = add("compile", compile_kernels, "compile kernels now, so that later starts are fast", f"compile {hill}")
    made.add_argument("scenario", nargs="?", metavar="SCENARIO", help=f"{SCENARIO}; none: all modules")
    filters.add_arguments(
        add("check-filter", usable(filters.run), "find the usual mistakes in a filter", filters.EXAMPLE)
    )
    fit_orbit.add_arguments(
        add("fit-orbit", fit_orbit.run, "fit an orbit of the Earth to a file of positions", fit_orbit.EXAMPLE)
    )
    limb.add_arguments(add("limb", usable(limb.run), "find disks of planets and moons in an image", limb.EXAMPLE))
    made = add("features", usable(vision.features), "find features in an image", vision.FEATURES_EXAMPLE)
    vision.features_arguments(made)
    made = add("catalogue", usable(vision.catalogue), "make a landmark catalogue from maps", vision.CATALOGUE_EXAMPLE)
    vision.catalogue_arguments(made)
    made = add("geolocate", usable(vision.geolocate), "find where a photo was taken", vision.LOCATE_EXAMPLE)
    vision.locate_arguments(made)
    add("info", info, "show versions, the compile cache and what is here", "info")
    return top


def main(argv: list[str] | None = None) -> int:
    """Run a command.

    Args:
        argv: arguments; those of the process if left out.

    Returns:
        The exit code: 0 well, 1 faults found or run failed, 2 bad usage or input, 130 interrupted.
    """
    args = parser().parse_args(argv)
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.insert(0, here)
    try:
        return args.action(args)
    except KeyboardInterrupt:
        print("fsw: interrupted", file=sys.stderr)
        return 130
    except Exception as error:
        if hasattr(args, "debug"):
            traceback.print_exc()
        text = str(error) if " " in str(error) else f"{type(error).__name__}: {error}"
        if isinstance(error, OSError) and error.filename is not None:
            text = f"{error.filename}: {error.strerror}"
        print(f"fsw: {text}", file=sys.stderr)
        return 2 if isinstance(error, UsageError) else 1


if __name__ == "__main__":
    sys.exit(main())
