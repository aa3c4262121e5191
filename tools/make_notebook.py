"""Make the notebook of the tutorial with a simulator from its page, so that it says the same.

python tools/make_notebook.py
"""

import argparse
import json
import pathlib
import re
from typing import Any

from cablecast.files import write_text

ROOT = pathlib.Path(__file__).parents[1]
PAGE = ROOT / "docs" / "tutorial-simulator.md"
NOTEBOOK = ROOT / "examples" / "tutorial.ipynb"
CODE_BLOCK = re.compile(r"^```python\n(.*?)^```\n", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\((?!\w+:)([^)\s]+)\)")


def notebook() -> dict[str, Any]:
    """Return the notebook: text and code of the page, cell by cell, without outputs."""
    cells = []
    text = LINK.sub(lambda found: f"]({_from_examples(found[1])})", PAGE.read_text())
    # The pieces between code blocks are text.
    for index, piece in enumerate(CODE_BLOCK.split(text)):
        if piece.strip():
            cells.append(_cell("code" if index % 2 else "markdown", piece.strip(), len(cells)))
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return {
        "cells": cells,
        "metadata": {"kernelspec": kernel, "language_info": {"name": "python"}},
        "nbformat": 4,
        "nbformat_minor": 5,
    }


def _from_examples(link: str) -> str:
    return link.removeprefix("../examples/") if link.startswith("../") else f"../docs/{link}"


def _cell(kind: str, text: str, number: int) -> dict[str, Any]:
    cell = {"cell_type": kind, "id": f"cell-{number:02}", "metadata": {}, "source": text}
    return cell | ({"execution_count": None, "outputs": []} if kind == "code" else {})


def content() -> str:
    """Return the notebook's file."""
    return json.dumps(notebook(), indent=1, ensure_ascii=False) + "\n"


def main() -> None:
    """Write the notebook."""
    argparse.ArgumentParser(description=main.__doc__).parse_args()
    write_text(NOTEBOOK, content())
    print(f"the notebook is {NOTEBOOK}")


if __name__ == "__main__":
    main()
