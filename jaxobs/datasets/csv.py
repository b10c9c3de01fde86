"""Numbers from a CSV file with a header, where nothing is missing unnoticed."""

import csv
from collections.abc import Sequence
from os import PathLike

import numpy as np

from jaxobs._module import refuse


def read_csv(path: str | PathLike[str], columns: Sequence[str], time: str | None = None) -> dict[str, np.ndarray]:
    """The named columns as float64 arrays.

    ValueError names a column that the header lacks, the row with a wrong number of fields or a field that is no finite
    number, and, for the column `time` [s], the row before which time does not increase or a gap of more than 1.5 periods opens.
    Data rows are counted, from 1, the first one under the header: blank lines are skipped and not counted. The file is UTF-8,
    with or without a byte order mark; fields may be quoted.
    """
    if isinstance(columns, str):
        raise refuse("read_csv", "columns", repr(columns), "a list of names", f"Give [{columns!r}].")
    header, *rows = _records(path)
    header = [name.strip() for name in header]
    for name in (*columns, *([time] if time else [])):
        if header.count(name) > 1:
            raise refuse("read_csv", name, f"{header.count(name)} columns", "one of that name", f"Rename them in {path}.")
        if name not in header:
            raise refuse("read_csv", name, "no such column", f"one of {', '.join(header)}", f"Check the header of {path}.")
    for number, row in enumerate(rows, start=1):
        if len(row) != len(header):
            raise refuse("read_csv", f"row {number}", f"{len(row)} fields", f"{len(header)}", f"Mend that row of {path}.")
    table = {name: _numbers(path, name, [row[header.index(name)] for row in rows]) for name in columns}
    if time:
        _check_clock(path, time, table.get(time, _numbers(path, time, [row[header.index(time)] for row in rows])))
    return table


def _records(path) -> list[list[str]]:
    """The header and the data rows, without blank lines."""
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            read = list(csv.reader(file, skipinitialspace=True, strict=True))
    except UnicodeDecodeError as error:
        given = f"byte 0x{error.object[error.start]:02x} at position {error.start}"
        raise refuse("read_csv", "path", given, "text in UTF-8", f"Save {path} again in that encoding.") from error
    except csv.Error as error:
        raise refuse("read_csv", "path", str(error), "comma-separated values", f"Mend the quotes of {path}.") from error
    rows = [row for row in read if len(row) > 1 or "".join(row).strip()]
    if not rows:
        raise refuse("read_csv", "path", "an empty file", "a header and rows of data", f"Check {path}.")
    return rows


def _numbers(path, name: str, fields: list[str]) -> np.ndarray:
    values = np.empty(len(fields))
    for i, field in enumerate(fields):
        try:
            values[i] = float(field)
        except ValueError:
            values[i] = np.nan
        if not np.isfinite(values[i]):
            given = f"{field!r} in row {i + 1}"
            raise refuse("read_csv", name, given, "a finite number", f"Drop or fill that row of {path}.")
    return values


def _check_clock(path, name: str, ts: np.ndarray) -> None:
    if len(ts) < 2:
        raise refuse("read_csv", name, f"{len(ts)} rows", "at least 2", f"{path} holds no record.")
    dts = np.diff(ts)
    if not np.all(dts > 0):
        row = int(np.argmin(dts > 0)) + 2
        raise refuse(
            "read_csv", name, f"{ts[row - 1]:.9g} in row {row}", "increasing times", "Sort the rows, drop doubled ones."
        )
    period = float(np.median(dts))
    if np.max(dts) > 1.5 * period:
        row = int(np.argmax(dts)) + 2
        given = f"a gap of {np.max(dts):.6g} s before row {row}"
        raise refuse("read_csv", name, given, f"a period of {period:.6g} s", "Insert the lost rows, or cut the record there.")
