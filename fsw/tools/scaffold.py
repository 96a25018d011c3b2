"""``fsw new-module``: a complete module folder with its test, from the templates."""

from __future__ import annotations

import keyword
import re
import shutil
import string
from importlib import resources
from pathlib import Path

DOMAINS: dict[str, str] = {
    **dict.fromkeys(("control", "estimation", "guidance", "opnav"), "modules"),
    **dict.fromkeys(("camera", "dynamics", "environment", "sensors"), "sim"),
}
"""On which side a domain is: ``modules`` would fly, ``sim`` is the truth."""


def new_module(name: str, root: Path, tier: str) -> list[Path]:
    """Make the folder of a module and its test, which pass every check.

    Args:
        name: "DOMAIN/NAME", such as "control/rate_damping". root: of the repository. tier: "kernel" or "python".

    Returns:
        The files made, relative to ``root``; the test is the last.

    Raises:
        ValueError: if the name is not usable or taken. OSError: if a file cannot be written; then none is left.
    """
    side, domain, own = ["", *name.split("/")][-3:] if name.count("/") in (1, 2) else ("", "", "")
    if not all(re.fullmatch(r"[a-z][a-z0-9_]{0,28}[a-z0-9]", p) and not keyword.iskeyword(p) for p in (domain, own)):
        raise ValueError(f"{name!r} is no module name; write DOMAIN/NAME in lower case, such as control/rate_damping")
    side = side or DOMAINS.get(domain, "")
    if side not in DOMAINS.values() or domain in ("data", "scenarios"):
        advice = f"the domains are {', '.join(sorted(DOMAINS))}; a new one is made by modules/{domain}/{own}"
        raise ValueError(f"there is no domain {name.rpartition('/')[0]!r}; {advice}")
    folder, test = Path(side, domain, own), Path("tests", side, domain, f"test_{own}.py")
    for taken in [root / folder, *(root / "tests").rglob(test.name)]:
        if taken.exists():
            raise ValueError(f"{taken.relative_to(root).as_posix()} exists already; choose another name")
    words = {
        "cls": "".join(part.capitalize() for part in own.split("_")),
        "package": ".".join(folder.parts),
        "id": own.replace("_", "-").upper(),
        "test": test.as_posix(),
    }
    templates = resources.files("fsw.tools") / "templates"
    sources = {folder / n: templates / f"{tier}_{n}.txt" for n in ("module.py", "kernel.py")}
    sources |= {folder / n: templates / f"{n}.txt" for n in ("__init__.py", "SPEC.md")}
    sources |= {test: templates / "test.py.txt"}
    texts = {p: string.Template(f.read_text(encoding="utf-8")).substitute(words) for p, f in sources.items()}
    if not (root / side / domain / "__init__.py").exists():
        texts = {Path(side, domain, "__init__.py"): f'"""Modules of the domain {domain}."""\n', **texts}
    try:
        for path, text in texts.items():
            (root / path).parent.mkdir(parents=True, exist_ok=True)
            (root / path).write_text(text, encoding="utf-8")
    except OSError:
        for path in texts:
            (root / path).unlink(missing_ok=True)
        shutil.rmtree(root / folder, ignore_errors=True)
        raise
    return list(texts)
