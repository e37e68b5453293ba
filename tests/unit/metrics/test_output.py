"""Files of metrics."""

import math

import pytest

from asrsim.metrics import MetricRow, read_metrics, write_metrics
from asrsim.plots.rows import metric_tables


@pytest.mark.parametrize("value", [0.1 + 0.2, -5e-324, math.nan, math.inf])
def test_metrics_are_read_as_written_and_infinite_ones_as_undefined(tmp_path, value):
    row = MetricRow(source='"a", b', joint="é", quantity="stiffness", measure="mean", value=value, unit="N m/rad")
    write_metrics(tmp_path / "metrics.csv", [row] * 2)
    found = read_metrics(tmp_path / "metrics.csv")
    assert [vars(one) for one in found] == [
        vars(row) | {"value": pytest.approx(value if value < 1 else math.nan, nan_ok=True)}
    ] * 2
    (table,) = metric_tables([row])
    assert (table[-1].cells == ["-"]) is not math.isfinite(value)


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[: text.index('b"')],  # the text ends within quotes
        lambda text: text.replace("mean,1.5", "mean,much"),
        lambda text: text.replace(",m\n", "\n"),
        lambda text: text.replace("measure", "mesure"),
        lambda text: "",
    ],
)
def test_a_damaged_file_of_metrics_is_refused(tmp_path, damage):
    path = tmp_path / "metrics.csv"
    write_metrics(path, [MetricRow(source="a", joint='a, b"c', quantity="deflection", measure="mean", value=1.5, unit="m")])
    text = path.read_text().replace("\r", "")
    assert damage(text) != text
    path.write_text(damage(text))
    with pytest.raises(ValueError, match=r"metrics\.csv|unpack|much"):
        read_metrics(path)
