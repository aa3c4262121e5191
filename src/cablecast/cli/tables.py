"""Printing of tables: whole numbers at any width, and names with brackets as they are."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table


def make_table(title: str, *heads: str, caption: str | None = None) -> "Table":
    """Return a table in the style of all verbs: names in the first column, then numbers."""
    from rich import box
    from rich.table import Table

    table = Table(title=title, caption=caption, box=box.SIMPLE)
    for number, head in enumerate(heads):
        table.add_column(head, justify="right" if number else "left", no_wrap=True)
    return table


def print_table(table: "Table", *notes: str) -> None:
    """Print a table, and below it sentences, each on a line of its own.

    A terminal that is too narrow breaks the lines; cut numbers would be wrong numbers.
    """
    from rich.console import Console

    # Brackets in the names of cables and rigs are no markup.
    console = Console(markup=False, emoji=False, highlight=False)
    wide = console.options.update(max_width=1000)
    console.width = max(console.width, console.measure(table, options=wide).maximum)
    console.print(table)
    for note in notes:
        print(note)
