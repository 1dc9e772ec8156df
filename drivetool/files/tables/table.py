"""One renderer of tables: nothing is cut and no word is broken, however long the names are."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePath

from rich.box import SIMPLE_HEAD
from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, Group
from rich.table import Table as RichTable
from rich.text import Text

from drivetool.files.yaml import escape_unprintable


@dataclass(frozen=True)
class Column:
    """One column of a table.

    title  its head, which folds between words
    right  whether its cells stand at the right
    fold   whether its cells fold between words, and names in them behind / . _ and -
    least  width to which names fold; they need more only where a word of them is longer
    rank   where not all fit, the column with the highest goes to a block below first, the last one of several
    """

    title: str = ""
    right: bool = False
    fold: bool = True
    least: int = 12
    rank: int = 0


@dataclass(frozen=True)
class Row:
    """The cells of a row; a `Text` has a style of its own."""

    cells: Sequence[str | Text]
    style: str = ""


@dataclass(frozen=True)
class Table:
    """A table as a value, which a console prints.

    rows   each with a cell per column
    title  a line above
    keys   how many of the first columns name a row: they stand in every block
    """

    columns: Sequence[Column]
    rows: Sequence[Row]
    title: str = ""
    keys: int = 1

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RichTable | Text]:
        """One block if it fits, else several; a line per cell where even a single column does not fit."""
        if self.title:
            yield Text(_printable(self.title), style="italic")
        sizes = [_sizes(column, [_printable(row.cells[i]) for row in self.rows])
                 for i, column in enumerate(self.columns)]
        blocks = self._blocks([least for least, _, _ in sizes], options.max_width)
        for block in blocks:
            yield self._block(block, _widths([sizes[i] for i in block], options.max_width), block == blocks[0])
        for row in () if blocks else self.rows:
            for column, cell in zip(self.columns, row.cells, strict=True):
                text = ": ".join(filter(None, (_printable(column.title), _printable(cell))))
                yield Text(_folded(text, options.max_width), row.style)

    def _blocks(self, least: Sequence[int], room: int) -> list[list[int]]:
        """The columns of every block; none where one column beside the keys is too wide."""
        blocks, rest = [], list(range(self.keys, len(self.columns)))
        while rest:
            block = list(rest)
            while block and sum(least[i] + 1 for i in (*range(self.keys), *block)) - 1 > room:
                block.remove(max(block, key=lambda i: (self.columns[i].rank, i)))
            if not block:
                return []
            blocks.append([*range(self.keys), *block])
            rest = [i for i in rest if i not in block]
        return blocks

    def _block(self, block: Sequence[int], widths: Sequence[int], first: bool) -> RichTable:
        """Some columns as Rich prints them; a later block leaves out the rows that have only dashes there."""
        table = RichTable(box=SIMPLE_HEAD, pad_edge=False, padding=0, show_edge=False,
                          show_header=any(column.title for column in self.columns))
        for i, width in zip(block, widths, strict=True):
            table.add_column(Text(_folded(_printable(self.columns[i].title), width)), width=width, no_wrap=True,
                             justify="right" if self.columns[i].right else "left")
        for row in self.rows:
            if first or {str(row.cells[i]) for i in block[self.keys:]} != {"-"}:
                cells = [(row.cells[i], width) for i, width in zip(block, widths, strict=True)]
                table.add_row(*(Text(_folded(_printable(cell), width), getattr(cell, "style", ""))
                                for cell, width in cells), style=row.style)
        return table


def numbers(*titles: str, rank: int = 0) -> list[Column]:
    """Columns of numbers, which do not fold."""
    return [Column(title, right=True, fold=False, rank=rank) for title in titles]


def pairs(rows: Iterable[tuple[str, str]]) -> Table:
    """Keys and what they stand for, without a head."""
    return Table((Column(fold=False), Column()), [Row((Text(f"{key} ", "bold"), text)) for key, text in rows])


def lines(texts: Iterable[str], style: str = "") -> Group:
    """Sentences below a table."""
    return Group(*(Text(f"  {escape_unprintable(text)}", style) for text in texts))


def short_labels(names: Iterable[str]) -> dict[str, str]:
    """Name -> label of a file in a table: without folder and suffix, which cost width, where that is unique."""
    stems = {name: PurePath(name).stem for name in dict.fromkeys(names)}
    many = Counter(stems.values())
    return {name: stem if many[stem] == 1 else name for name, stem in stems.items()}


def _printable(cell: str | Text) -> str:
    """A cell on one line."""
    return escape_unprintable(str(cell)).replace("\n", r"\n").replace("\t", r"\t")


def _folded(text: str, width: int) -> str:
    """The text in lines: broken between words, and within a longer name behind its separators alone."""
    folded = [""]
    for word in re.findall(r"\s*\S+", text):
        long = cell_len(word.strip()) > width
        for part in re.findall(r"\s*[^/._-]*[/._-]*", word) if long else (word,):
            if folded[-1].strip() and cell_len(folded[-1] + part) > width:
                folded.append(part.lstrip())
            else:
                folded[-1] += part
    return "\n".join(folded)


def _sizes(column: Column, cells: Sequence[str]) -> tuple[int, int, int]:
    """Width of a column: at least, with whole cells, and with its head on one line."""
    title, whole = _printable(column.title), max(map(cell_len, cells), default=0)
    head = _widest([title], min(column.least, max(map(cell_len, title.split()), default=0)))
    narrow = _widest(cells, column.least) if column.fold else whole
    return max(head, narrow), max(head, whole), max(cell_len(title), whole)


def _widest(texts: Iterable[str], width: int) -> int:
    """The longest line of texts that were folded to a width."""
    return max((cell_len(line) for text in texts for line in _folded(text, width).split("\n")), default=0)


def _widths(sizes: Sequence[tuple[int, int, int]], room: int) -> list[int]:
    """Heads fold first, then the widest cells."""
    widths = [whole for _, _, whole in sizes]
    while sum(widths) + len(widths) - 1 > room:
        i = max(range(len(widths)), key=lambda i: (widths[i] > sizes[i][1], widths[i] > sizes[i][0], widths[i]))
        widths[i] -= 1
    return widths
