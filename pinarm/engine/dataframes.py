"""pandas, where it is installed: it takes half a second to import, and pinarm needs it for nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from pinarm.errors import InputError

if TYPE_CHECKING:
    from pandas import DataFrame


def dataframe(
    data: Mapping[str, Any] | Sequence[Any] | NDArray[Any], columns: Sequence[str] | None = None
) -> DataFrame:
    """Return a table of pandas; see ``pandas.DataFrame``.

    Raises:
        InputError: pandas is not installed.
    """
    try:
        pandas = import_module("pandas")
    except ImportError:
        raise InputError("pandas is not installed", hint="pip install 'pinarm[table]'") from None
    table: DataFrame = pandas.DataFrame(data, columns=columns)
    return table
