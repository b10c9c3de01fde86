"""A recorded signal from a CSV file of the user's: which column is the time, which the signal, and what is missing."""

import dataclasses
from pathlib import Path
from typing import Any

from jaxobs._module import refuse
from jaxobs.cli.reading import unknown


@dataclasses.dataclass(frozen=True)
class Names:
    """The columns of a record."""

    time: str
    signal: str

    def derivatives(self, order: int) -> list[str]:
        """angle, angle', angle''."""
        return [self.signal + "'" * k for k in range(order + 1)]


def read_record(path: Path, time: str | None, column: str | None) -> tuple[Any, Names]:
    """(series, names): a pandas Series of floats over its times, NaN where a sample was lost. ValueError names the option that
    does not fit, and the row of a field that is no number."""
    import pandas as pd

    try:
        table = pd.read_csv(path, skipinitialspace=True)
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise refuse("differentiate", "record", str(error), "comma-separated values with a header", "Save it so.") from error
    columns = [str(name) for name in table.columns]
    if len(columns) < 2:
        fix = "Give the file a header and a column of times."
        raise refuse("differentiate", "record", f"the columns {columns}", "a time and a signal", fix)
    for option, name in (("--time", time), ("--column", column)):
        if name is not None and name not in columns:
            raise ValueError(str(unknown(option, name, columns)).replace("config.", ""))
    time = time or next(name for name in columns if name != column)
    others = [name for name in columns if name != time]
    if column is None and len(others) > 1:
        raise refuse(
            "differentiate", "--column", "nothing", f"one of {', '.join(others)}", f"For example --column {others[0]}."
        )
    column = column or others[0]
    index = _times(table[time], time)
    return pd.Series(_numbers(table[column], column), index=index, name=column), Names(time, column)


def _numbers(values: Any, name: str) -> Any:
    import pandas as pd

    numbers: Any = pd.to_numeric(values, errors="coerce")
    odd = numbers.isna() & values.notna()
    if odd.any():
        row = int(odd.to_numpy().argmax())
        given = f"{values.iloc[row]!r} in row {row + 1} of {name!r}"
        raise refuse("differentiate", "record", given, "a number, or nothing for a lost sample", "Mend that field.")
    return numbers.to_numpy(float)


def _times(values: Any, name: str) -> Any:
    """Seconds as they are, dates (ISO 8601: of others it is a guess which is the day) as dates."""
    import pandas as pd

    if pd.api.types.is_numeric_dtype(values):
        return pd.Index(values.to_numpy(float), name=name)
    try:
        return pd.DatetimeIndex(pd.to_datetime(values, format="ISO8601"), name=name)
    except (ValueError, TypeError) as error:
        given = f"{str(values.iloc[0])!r} in {name!r}"
        expected = "seconds or dates like 2026-11-22 20:47:37.5"
        raise refuse("differentiate", "--time", given, expected, "Name the column of times.") from error
