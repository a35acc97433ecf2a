"""Figures of a result, by names that tell their units."""

from typing import Any

import numpy as np

Report = dict[str, Any]
"""What report.json holds: numbers, texts, lists and further reports by name."""


def statistics(values: Any, unit: str) -> Report:
    """Mean, median and percentiles, keys with the unit."""
    values = np.asarray(values, np.float64)
    if not len(values):
        return {"count": 0}
    median, p95, p99 = np.percentile(values, [50, 95, 99])
    return {
        "count": len(values),
        f"mean_{unit}": float(values.mean()),
        f"median_{unit}": float(median),
        f"p95_{unit}": float(p95),
        f"p99_{unit}": float(p99),
        f"max_{unit}": float(values.max()),
    }
