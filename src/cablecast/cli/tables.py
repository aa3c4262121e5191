"""Printing of tables: whole numbers at any width, and names with brackets as they are."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.table import Table


def make_table(title: str, **options: Any) -> "Table":
    """Return an empty table in the style of all verbs.

    Args:
        title: Title above it.
        **options: Further options of a rich table.
    """
    from rich import box
    from rich.table import Table

    return Table(title=title, box=box.SIMPLE, **options)


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
