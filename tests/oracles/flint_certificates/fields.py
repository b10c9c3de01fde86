"""Reading the fields of a certificate file, each as what its theorem says it is."""

import math

import flint


class Malformed(ValueError):
    """The numbers are not of the theorem's types and shapes, or not finite."""


class Fields:
    """The fields of one file by name; Malformed when one is absent or something else."""

    def __init__(self, data):
        self.data = data

    def _raw(self, name, kind):
        value = self.data.get(name)
        if not isinstance(value, kind) or isinstance(value, bool):
            raise Malformed(f"{name}: {value!r}")
        return value

    def integer(self, name):
        return self._raw(name, int)

    def scalar(self, name):
        return rational(self._raw(name, str))

    def vector(self, name, length=None):
        value = self._raw(name, list)
        if length is not None and len(value) != length:
            raise Malformed(f"{name}: {len(value)} numbers for {length}")
        return [rational(entry) for entry in value]

    def integers(self, name):
        value = self._raw(name, list)
        if any(type(entry) is not int for entry in value):
            raise Malformed(f"{name}: {value!r}")
        return value

    def _rows(self, name, columns):
        value = self._raw(name, list)
        if any(not isinstance(row, list) or len(row) != (len(value[0]) if columns is None else columns) for row in value):
            raise Malformed(f"{name}: ragged, or not {columns} columns")
        return [[rational(entry) for entry in row] for row in value]

    def rows(self, name, columns=None):
        """As many rows as there are, one at least, of one length, one at least."""
        value = self._rows(name, columns)
        if not value or not value[0]:
            raise Malformed(f"{name}: empty")
        return value

    def matrix(self, name, rows, columns):
        value = self._rows(name, columns)
        if len(value) != rows:
            raise Malformed(f"{name}: {len(value)} rows for {rows}")
        return matrix(value, columns)

    def given(self, name):
        """Whether a field that may be empty is not."""
        return self._raw(name, list) != []

    def text(self, name):
        return self._raw(name, str)


def rational(text):
    if not isinstance(text, str):
        raise Malformed(repr(text))
    try:
        value = float.fromhex(text)
    except (ValueError, OverflowError) as error:
        raise Malformed(text[:40]) from error
    if not math.isfinite(value):
        raise Malformed(text)
    return flint.fmpq(*value.as_integer_ratio())


def matrix(rows, columns=None):
    width = len(rows[0]) if columns is None and rows else columns or 0
    return flint.fmpq_mat(len(rows), width, [entry for row in rows for entry in row])
