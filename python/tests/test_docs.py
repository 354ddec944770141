"""What the pages of the documentation show runs, and what their tables say is so."""

from __future__ import annotations

import builtins
import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import gymnasium
import pytest

import lanecraft

ROOT = Path(__file__).parents[2]
PAGES = ["docs/python.md", "docs/from-highway-env.md", "python/README.md"]
#: What a snippet must find, and is not installed in every run.
OPTIONAL = ["pandas", "stable_baselines3", "sb3_contrib", "torch"]


def snippets(page: str) -> list[str]:
    """The Python blocks of a page, in order."""
    return re.findall(r"^```python\n(.*?)^```$", (ROOT / page).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize(("page", "number"), [(page, number) for page in PAGES for number in range(len(snippets(page)))])
def test_snippets_run_alone(page, number, tmp_path, monkeypatch):
    code = snippets(page)[number]
    for module in OPTIONAL:
        if re.search(rf"^(import|from) {module}\b", code, re.MULTILINE):
            pytest.importorskip(module)
    monkeypatch.chdir(tmp_path)
    exec(compile(code, f"{page}#{number}", "exec"), {"__name__": "__main__"})


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    for target, anchor in re.findall(r"\]\((?!https?:)([^)#]*)(#[^)]*)?\)", text):
        file = (ROOT / page).parent / target if target else ROOT / page
        assert file.exists(), target
        if anchor:
            headings = re.findall(r"^#+ (.*)$", file.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor[1:] in [slug(heading) for heading in headings], anchor


def slug(heading: str) -> str:
    """A heading as GitHub names its anchor."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def test_without_stable_baselines3_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    monkeypatch.delitem(sys.modules, "lanecraft.sb3", raising=False)
    with pytest.raises(ImportError, match=r"pip install 'lanecraft\[sb3\]'"):
        importlib.import_module("lanecraft.sb3")


def table(page: str, heading: str) -> list[list[str]]:
    """The first table below a heading, without its head."""
    below = (ROOT / page).read_text(encoding="utf-8").split(f"\n## {heading}\n")[1]
    rows = re.search(r"^\| --- .*\n((?:\|.*\n)+)", below, re.MULTILINE)
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows[1].splitlines()]


@pytest.mark.parametrize(("column", "presets"), [(3, ["default", "paper"]), (4, ["fast"])])
def test_the_table_of_info_lists_the_real_keys(column, presets):
    listed = [row[0].strip("`") for row in table("docs/python.md", "Info") if row[column] == "x"]
    for preset in presets:
        _, info = lanecraft.Env(preset=preset).reset(seed=0)
        assert listed == list(info)


def test_the_table_of_info_tells_units():
    units = {"s": "_s", "m": "_m", "m/s": "_mps", "m/s²": "_mps2"}
    for name, unit, *_ in table("docs/python.md", "Info"):
        ending = re.search(r"_(s|m|mps|mps2)`$", name)
        assert units.get(unit) == (ending and ending[0].strip("`")), name


def test_the_table_of_ids_lists_what_is_registered():
    ids = {row[0].strip("`"): row[1].strip("`") for row in table("docs/python.md", "First steps")}
    for name, preset in ids.items():
        assert gymnasium.spec(name).kwargs == {"preset": preset}


def test_the_table_of_exceptions_is_so():
    for name, base, _ in table("docs/python.md", "Exceptions")[:3]:
        kind = getattr(lanecraft, name.strip("`").removeprefix("lanecraft."))
        assert issubclass(kind, (lanecraft.LanecraftError, getattr(builtins, base.strip("`"))))


@pytest.mark.parametrize("module", ["lanecraft.highway_env", "highway_env"])
def test_the_script_of_the_way_over_runs_on_both_sides(module, tmp_path):
    """The page's first script, in a process of its own: ids are registered once."""
    script = snippets("docs/from-highway-env.md")[0]
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"{module} is not installed")
    assert "import lanecraft.highway_env\n" in script
    path = tmp_path / "script.py"
    path.write_text(script.replace("import lanecraft.highway_env\n", f"import {module}\n"), encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    assert "'on_road_reward': 1.0" in done.stdout
