"""The notebook runs and shows what is stored in it. ``LANECRAFT_UPDATE=1 pytest tests/test_notebook.py`` stores what it shows now."""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import os
import zlib
from pathlib import Path
from typing import Any

NOTEBOOK = Path(__file__).parents[1] / "examples" / "first_steps.ipynb"
#: GitHub is slow with larger ones.
LARGEST_BYTES = 300_000


def run(source: str, names: dict[str, Any], count: int) -> list[dict[str, Any]]:
    """What a cell prints, and what its last expression is."""
    tree, outputs, printed = ast.parse(source), [], io.StringIO()
    last = ast.Expression(tree.body.pop().value) if isinstance(tree.body[-1], ast.Expr) else None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, "cell", "exec"), names)
        value = None if last is None else eval(compile(last, "cell", "eval"), names)
    if printed.getvalue():
        outputs.append({"name": "stdout", "output_type": "stream", "text": printed.getvalue().splitlines(keepends=True)})
    if value is not None:
        data = {"text/plain": [repr(value)]}
        if hasattr(value, "_repr_png_"):
            data["image/png"] = base64.b64encode(value._repr_png_()).decode()
        outputs.append({"data": data, "execution_count": count, "metadata": {}, "output_type": "execute_result"})
    return outputs


def comparable(outputs: list[dict[str, Any]]) -> list[Any]:
    """Texts as they are, pictures by their pixels: packed, they differ from one zlib to the next."""
    shown = []
    for output in outputs:
        shown.append(output.get("text") or output["data"]["text/plain"])
        if "image/png" in output.get("data", {}):
            png = base64.b64decode(output["data"]["image/png"])
            at = png.index(b"IDAT")
            shown.append(zlib.decompress(png[at + 4 : at + 4 + int.from_bytes(png[at - 4 : at], "big")]))
    return shown


def test_the_notebook_shows_what_comes_out():
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    names: dict[str, Any] = {"__name__": "__main__"}
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for count, cell in enumerate(cells, start=1):
        outputs = run("".join(cell["source"]), names, count)
        if os.environ.get("LANECRAFT_UPDATE") == "1":
            cell["outputs"], cell["execution_count"] = outputs, count
        assert comparable(cell["outputs"]) == comparable(outputs), f"cell {count} shows something else"
    if os.environ.get("LANECRAFT_UPDATE") == "1":
        NOTEBOOK.write_text(json.dumps(notebook, ensure_ascii=False, indent=1) + "\n", encoding="utf-8")


def test_the_notebook_is_small():
    assert NOTEBOOK.stat().st_size < LARGEST_BYTES
