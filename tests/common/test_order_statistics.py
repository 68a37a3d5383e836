"""Order statistics without sorting, from a table that is kept in a file."""

from functools import partial
from typing import Any

import numpy as np
import pytest

from common import spool as spool_module
from common.order_statistics import Numbers, order_statistics, quantiles
from common.spool import Spool

TABLES = {
    "integers": np.random.default_rng(0).integers(-(2**63), 2**63 - 1, 5000),
    "small integers, often equal": np.random.default_rng(1).integers(-3, 4, 5000),
    "real numbers": np.random.default_rng(2).normal(0.0, 1e3, 5000),
    "over many magnitudes": np.random.default_rng(3).lognormal(0.0, 30.0, 5000),
    "zeros and ends": np.array([0.0, -0.0, -1e300, 1e300, 5e-324, -5e-324] * 9),
    "one": np.array([-7.5]),
}


@pytest.mark.parametrize("numbers", TABLES.values(), ids=TABLES)
def test_they_are_those_of_the_sorted_numbers(numbers: Numbers) -> None:
    last = len(numbers) - 1
    ranks = [0, last // 2, round(0.99 * last), last, last // 2]
    parts: list[Any] = np.array_split(numbers, 7)
    found = order_statistics(lambda: parts, ranks)
    assert found == np.sort(numbers)[ranks].tolist()


def test_quantiles_are_those_of_numpy() -> None:
    numbers = np.random.default_rng(4).normal(size=1234)
    shares = [0.0, 0.01, 0.5, 0.99, 1.0]
    found = quantiles(lambda: np.array_split(numbers, 3), len(numbers), shares)
    assert found == pytest.approx(np.quantile(numbers, shares).tolist(), rel=1e-14)


@pytest.mark.parametrize("rows", [0, 1, 63, 64, 65, 1000])
def test_columns_of_a_table_come_back_from_its_file(
    rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(spool_module, "BLOCK", 64)
    table = np.random.default_rng(rows).integers(-9, 9, (rows, 3))
    spool = Spool(3, "q")
    spool.add(table[: rows // 2])
    spool.extend(table[rows // 2 :].ravel().tolist())
    assert len(spool) == rows
    parts = list(spool.parts(2, 0))
    assert len(parts) == 1 + rows // 64
    assert np.concatenate([last for last, _ in parts]).tolist() == table[:, 2].tolist()
    assert np.concatenate([first for _, first in parts]).tolist() == table[:, 0].tolist()
    if rows:
        middle = order_statistics(partial(_column, spool, 1), [rows // 2])
        assert middle == [np.sort(table[:, 1])[rows // 2]]


def _column(spool: Spool, column: int) -> list[Numbers]:
    return [part for (part,) in spool.parts(column)]
