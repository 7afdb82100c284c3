"""A table in a terminal whose cells are text: rich's markup has no part in it."""

from typing import Any

from rich.table import Table
from rich.text import Text

from phalanx.launcher.printable import printable


class TextTable(Table):
    """Shows str as printable; a cell of another style is made by styled."""

    def __init__(self, *headers: str, **options: Any) -> None:
        super().__init__(*headers, box=None, pad_edge=False, **options)

    def add_column(self, header: Any = "", *others: Any, **options: Any) -> None:
        """Add a column, as rich's table does."""
        super().add_column(_as_text(header), *others, **options)

    def add_row(self, *cells: Any, **options: Any) -> None:
        """Add a row, as rich's table does."""
        super().add_row(*map(_as_text, cells), **options)


def styled(text: str, style: str) -> Text:
    """A cell in a style of rich's."""
    return Text(printable(text), style)


def _as_text(cell: Any) -> Any:
    return styled(cell, "") if isinstance(cell, str) else cell
