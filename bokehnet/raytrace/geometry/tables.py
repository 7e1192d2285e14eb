"""Row selection in frozen dataclasses of tensors that share their first dimension."""

from dataclasses import fields
from typing import Any, TypeVar

import torch
from torch import Tensor

__all__ = ["join", "pick"]

Table = TypeVar("Table")


def pick(table: Table, rows: Tensor) -> Table:
    """Return the rows of all tensors in ``table`` and its nested tables that an index or a mask selects."""
    return _rebuild(lambda columns: columns[0][rows], [table])


def join(first: Table, second: Table) -> Table:
    """Return the concatenated rows of two tables of one type."""
    return _rebuild(torch.cat, [first, second])


def _rebuild(make: Any, tables: list[Any]) -> Any:
    if isinstance(tables[0], Tensor):
        return make(tables)
    columns = {
        field.name: _rebuild(make, [getattr(table, field.name) for table in tables])
        for field in fields(tables[0])
    }
    return type(tables[0])(**columns)
