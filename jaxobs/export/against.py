"""The numbers of an exported C file, read back and held against a certificate."""

import hashlib
import re
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jaxobs.certificates import AbstractCertificate
from jaxobs.export.c_file import SEAL
from jaxobs.export.corrections import places, stored_table

TABLE = re.compile(r"static const real (\w+)\[(\d+)\] = \{\n(.*?)\n\};", re.DOTALL)
NUMBER = re.compile(r"(-?0x[01]\.[0-9a-f]+p[+-]\d+)f?, /\*")
HASH = re.compile(r"^ \* certificate: (\S+) sha256 ([0-9a-f]{64})$", re.MULTILINE)


class CodeFile(NamedTuple):
    """tables by name; the hash of the certificate, None without one; whether the code is as it was written."""

    tables: dict[str, np.ndarray]
    sha256: str | None
    whole: bool


def read_c(path: str | PathLike[str]) -> CodeFile:
    """What an exported C file says. ValueError if it is none."""
    text = Path(path).read_text(encoding="utf-8")
    head, separator, body = text.partition(" */\n")
    seal = re.search(rf"{SEAL}: ([0-9a-f]{{64}})", head)
    if not separator or seal is None:
        raise ValueError(f"{path}: given a file without a seal; expected C code written by jaxobs.export or `jaxobs export`")
    tables = {}
    for name, count, rows in TABLE.findall(body):
        numbers = [float.fromhex(one) for one in NUMBER.findall(rows)]
        if len(numbers) != int(count):
            raise ValueError(f"{path}: given {len(numbers)} numbers in {name}[{count}]; expected {count} in hexadecimal")
        tables[name] = np.array(numbers)
    found = HASH.search(head)
    whole = hashlib.sha256(body.encode()).hexdigest() == seal[1]
    return CodeFile(tables, found[2] if found else None, whole)


def differences(code: CodeFile, certificate: AbstractCertificate, sha256: str) -> list[str]:
    """Why the code is not what the certificate, whose file has this hash, is about; nothing if it is."""
    found = []
    if not code.whole:
        found.append("the code was changed after it was written: its seal does not match")
    if code.sha256 is None:
        found.append("the code names no certificate")
    elif code.sha256 != sha256:
        found.append(f"the code names the certificate {code.sha256}, this one is {sha256}")
    if not places(certificate):
        found.append(f"theorem {certificate.theorem} is about no gain")
    for name in places(certificate):
        stored, table = stored_table(certificate, name).reshape(-1), code.tables.get(name)
        if table is None and stored.size:
            found.append(f"the code has no table {name}")
        elif table is not None and not np.array_equal(stored, table):
            found.append(f"{name} in the code is {table.tolist()}, in the certificate {stored.tolist()}")
    return found
