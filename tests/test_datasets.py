"""datasets: the recorded walk, and a CSV reader that names every flaw."""

import re

import numpy as np
import pytest
from scipy.signal import savgol_filter

from jaxobs.datasets import read_csv, shank_walk


def test_the_walk_and_its_independent_rate():
    walk = shank_walk()
    assert walk.ts.shape == walk.angle.shape == walk.rate.shape == (3511,)
    dt = (walk.ts[-1] - walk.ts[0]) / 3510
    assert dt == pytest.approx(1 / 120, rel=1e-3)
    smooth = savgol_filter(walk.angle, 11, 3, deriv=1, delta=dt)
    assert np.corrcoef(smooth, walk.rate)[0, 1] > 0.99
    slope, _ = np.polyfit(walk.rate, smooth, 1)
    assert round(slope, 2) == 1.00
    assert np.all(np.abs(np.diff(walk.angle)) < np.pi)


def write(tmp_path, text):
    (tmp_path / "r.csv").write_text(text, encoding="utf-8", newline="")
    return tmp_path / "r.csv"


def test_reads_named_columns_in_any_order(tmp_path):
    path = write(tmp_path, "t, a ,b\n0,1,x\n0.5,2e-3,y\n\n1.0, 3 ,z\n")
    table = read_csv(path, ["a", "t"], time="t")
    assert list(table) == ["a", "t"]
    assert table["a"].tolist() == [1, 0.002, 3]
    assert table["a"].dtype == np.float64
    assert read_csv(path, ["a"], time="t").keys() == {"a"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("t,b\n0,1\n1,2\n", ["read_csv.a", "no such column", "t, b"]),
        ("s,a\n0,1\n1,2\n", ["read_csv.t", "no such column", "s, a"]),
        ("", ["read_csv.path", "an empty file"]),
        ("\n \n", ["read_csv.path", "an empty file"]),
        ("t,a,a\n0,1,2\n", ["read_csv.a", "2 columns", "one of that name"]),
        ("t,a\n\n0,1\n \n1,two\n", ["read_csv.a", "'two' in row 2"]),
        ('t,a\n0,1\n1,"2\n', ["read_csv.path", "quotes"]),
        ("t,a\n0,1\n1\n2,3\n", ["row 2", "1 fields", "expected 2"]),
        ("t,a\n0,1\n1,2,3\n", ["row 2", "3 fields"]),
        ("t,a\n0,1\n1,two\n2,3\n", ["read_csv.a", "'two' in row 2", "finite number"]),
        ("t,a\n0,1\n1,\n", ["read_csv.a", "'' in row 2"]),
        ("t,a\n0,1\n1,nan\n", ["read_csv.a", "'nan' in row 2"]),
        ("t,a\n0,1\n1,inf\n", ["read_csv.a", "'inf' in row 2"]),
        ("t,a\n0,1\nnow,2\n", ["read_csv.t", "'now' in row 2"]),
        ("t,a\n0,1\n1,2\n2,3\n4,4\n5,5\n", ["a gap of 2 s before row 4", "a period of 1 s"]),
        ("t,a\n0,1\n1,2\n1,3\n2,4\n", ["increasing times", "1 in row 3"]),
        ("t,a\n0,1\n2,2\n1,3\n", ["increasing times", "1 in row 3"]),
        ("t,a\n0,1\n", ["1 rows", "at least 2"]),
        ("t,a\n", ["0 rows", "at least 2"]),
    ],
)
def test_flaws_are_named(tmp_path, text, words):
    path = write(tmp_path, text)
    with pytest.raises(ValueError, match=re.escape(words[0])) as caught:
        read_csv(path, ["a"], time="t")
    assert all(word in str(caught.value) for word in words), caught.value


def test_without_a_clock_the_rows_may_come_in_any_order(tmp_path):
    assert read_csv(write(tmp_path, "t,a\n3,1\n1,2\n"), ["t"])["t"].tolist() == [3, 1]


def test_a_byte_order_mark_and_quotes_are_read(tmp_path):
    path = write(tmp_path, '\ufefft,"speed, m/s"\r\n"0", "1.5"\r\n1,2\r\n')
    assert read_csv(path, ["speed, m/s"], time="t")["speed, m/s"].tolist() == [1.5, 2]


def test_columns_are_a_list_of_names(tmp_path):
    with pytest.raises(ValueError, match=r"read_csv\.columns: given 'a'; expected a list of names. Give \['a'\]"):
        read_csv(write(tmp_path, "t,a\n0,1\n"), "a")


def test_bytes_that_are_no_text_are_refused(tmp_path):
    (tmp_path / "r.csv").write_bytes("t,a\n0,1 µ\n".encode("latin-1"))
    with pytest.raises(ValueError, match=r"read_csv\.path: given byte 0xb5 at position 8; expected text in UTF-8"):
        read_csv(tmp_path / "r.csv", ["a"])
