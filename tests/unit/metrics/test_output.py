"""Files of metrics."""

import math

import pytest

from asrsim.metrics import MetricRow, read_metrics, write_metrics


@pytest.mark.parametrize("value", [0.1 + 0.2, -5e-324, math.nan, math.inf])
def test_metrics_are_read_as_written_and_infinite_ones_as_undefined(tmp_path, value):
    row = MetricRow(source='"a", b', joint="é", quantity="stiffness", measure="mean", value=value, unit="N m/rad")
    write_metrics(tmp_path / "metrics.csv", [row] * 2)
    found = read_metrics(tmp_path / "metrics.csv")
    assert [vars(one) for one in found] == [
        vars(row) | {"value": pytest.approx(value if value < 1 else math.nan, nan_ok=True)}
    ] * 2
