"""The run from the command line to the files, and its exit codes."""

from __future__ import annotations

import contextlib
import json
import sys
import time
import traceback
from collections.abc import Callable, Generator, Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from fsw import ModuleError
from modules.estimation.pose_from_landmarks import FixStatus
from sim.scenarios.iss_photos.camera_file import calibration_json
from sim.scenarios.iss_photos.graph import Run, build
from sim.scenarios.iss_photos.inputs import BAD, Inputs, read_inputs
from sim.scenarios.iss_photos.options import Options, parse
from sim.scenarios.iss_photos.overlay import draw_overlay, overlay_name
from sim.scenarios.iss_photos.plots import errors_plot, ground_track_plot
from sim.scenarios.iss_photos.report import LIMITS, shift_table, show
from sim.scenarios.iss_photos.results import Results, collect, tuned_cadence
from sim.scenarios.iss_photos.shift import ShiftRow, shift_study
from sim.scenarios.iss_photos.writing import fixes_csv, output_folder, track_csv

_ENOUGH = 2
_WIDTH = 118
OK, NO_PHOTO, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
Ticker = Callable[[str, int], contextlib.AbstractContextManager[Callable[[], None]]]


def locate(inputs: Inputs, ticker: Ticker) -> Run:
    """Play the photos through the graph, as often as it takes.

    Without a calibration: first, from the last photo to the first, until two are located; each of them improves what is
    known of mounting and lens. Then all photos, to calibrate; then all again for the result. If more poses are clear
    but far from the orbit than agree with it, the orbit is in doubt, and those get a second try that trusts it less.
    """
    run = build(inputs)
    every = list(range(len(inputs.played)))
    if inputs.accuracy is None:
        with ticker("first look", len(every)) as tick:
            located = 0
            for i in reversed(every):
                located += run.round([i], tick, calibrate=True)[i] is FixStatus.VALID
                if located == _ENOUGH:
                    break
        if not located:
            return run
        with ticker("calibration", len(every)) as tick:
            run.round(every, tick, calibrate=True)
    with ticker("positions", len(every)) as tick:
        done = run.round(every, tick)
    far = [i for i in every if done[i] is FixStatus.AGAINST_PRIOR]
    if len(far) > sum(status is FixStatus.VALID for status in done.values()):
        with ticker("orbit in doubt", len(far)) as tick:
            run.round(far, tick, attempt=1)
    return run


def write_results(folder: Path, inputs: Inputs, results: Results, shifts: list[ShiftRow]) -> None:
    """Write all result files."""
    (folder / "fixes.csv").write_text(fixes_csv(results.fixes), encoding="utf-8")
    if results.track is not None:
        (folder / "track.csv").write_text(track_csv(results.track, inputs.epoch), encoding="utf-8")
    if results.accuracy is not None:
        cadence = tuned_cadence(inputs.times.cadence, results.clock)
        (folder / "calibration.json").write_bytes(calibration_json(results.camera, results.accuracy, cadence, LIMITS))
    if shifts:
        (folder / "shift_study.json").write_text(
            json.dumps([row.as_dict() for row in shifts], indent=2) + "\n", "utf-8"
        )
    overlays = folder / "overlays"
    overlays.mkdir()
    for fix in results.fixes:
        if fix.utc is not None:
            (overlays / overlay_name(fix.path)).write_bytes(draw_overlay(fix, results.camera, inputs.geo_map))
    if results.summary is not None:
        errors_plot(folder / "errors.png", results)
        ground_track_plot(folder / "ground_track.png", inputs, results)


def _ticker(console: Console) -> Ticker:
    @contextlib.contextmanager
    def stage(name: str, total: int) -> Generator[Callable[[], None]]:
        columns = TextColumn("{task.description:16s}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
        with Progress(*columns, console=console) as progress:
            task = progress.add_task(name, total=total)
            yield lambda: progress.advance(task)
            progress.update(task, total=progress.tasks[task].completed)

    return stage


def run(options: Options, console: Console) -> int:
    """Do everything; returns the exit code. Errors are raised."""
    started = time.monotonic()
    inputs = read_inputs(options)
    with output_folder(options.out) as folder:
        ticker = _ticker(console)
        results = collect(inputs, locate(inputs, ticker))
        show(console, results)
        shifts: list[ShiftRow] = []
        if options.shift_study and results.summary is not None:
            shifts = shift_study(inputs, results, ticker)
            console.print(shift_table(shifts))
        write_results(folder, inputs, results, shifts)
    console.print(f"results are in {options.out} ({time.monotonic() - started:.0f} s)", soft_wrap=True)
    if results.summary is None:
        console.print("[red]no photo could be located[/red]; the reasons are above and in fixes.csv")
        return NO_PHOTO
    return OK


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the scenario; returns the exit code: 0 a result, 1 no photo could be located, 2 bad input."""
    options = parse(arguments)
    errors = Console(stderr=True)
    try:
        return run(options, Console(width=None if sys.stdout.isatty() else _WIDTH))
    except KeyboardInterrupt:
        errors.print("interrupted; nothing was written")
        return INTERRUPTED
    except (*BAD, ModuleError) as error:
        cause = error.__cause__
        told = cause if isinstance(error, ModuleError) and isinstance(cause, BAD) else error
        if options.debug:
            traceback.print_exc(file=sys.stderr)
        errors.print(f"[red]error:[/red] {escape(str(told))}", soft_wrap=True, markup=True, highlight=False)
        return BAD_INPUT
