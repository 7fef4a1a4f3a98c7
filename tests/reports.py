"""An identification as its document, and a report as it is printed."""

import io
from typing import Any

from rich.console import Console, RenderableType


def printed(renderable: RenderableType, width: int = 80, encoding: str = "utf-8") -> str:
    raw = io.BytesIO()
    file = io.TextIOWrapper(raw, encoding=encoding, newline="")
    Console(file=file, width=width).print(renderable)
    file.flush()
    return raw.getvalue().decode(encoding)


def experiment(name: str, pit: float | None, **changes: Any) -> dict[str, Any]:
    return {
        "id": name,
        "outcome": 0.81234,
        "log_density": 1.5,
        "mean": 0.8,
        "standard_deviation": 0.02,
        "skewness": 0.0,
        "kurtosis": 3.0,
        "quantiles": {"0.025": 0.76, "0.25": 0.78, "0.5": 0.8, "0.75": 0.82, "0.975": 0.84},
        "pit": pit,
        "status": "solved",
        "surface_error": None,
        **changes,
    }


def result(**changes: Any) -> dict[str, Any]:
    return {
        "title": "Wet clutch",
        "seed": 4,
        "alpha": {
            "c2_scale.mean": {
                "estimate": 0.912345,
                "standard_error": 0.01234,
                "sandwich_error": 0.0301,
                "interval": [0.88816, 0.93653],
                "at_bound": None,
                "fixed": False,
            },
            "c2_scale.sd": {
                "estimate": 0.005,
                "standard_error": None,
                "sandwich_error": None,
                "interval": None,
                "at_bound": "lower",
                "fixed": False,
            },
            "b0.value": {
                "estimate": -9.0,
                "standard_error": None,
                "sandwich_error": None,
                "interval": None,
                "at_bound": None,
                "fixed": True,
            },
        },
        "correlation": {"names": ["a", "b"], "matrix": [[1.0, -0.95], [-0.95, 1.0]]},
        "log_likelihood": {
            "estimated": 262.51234,
            "verified": 262.4,
            "verified_standard_error": 0.13,
        },
        "density": "maximum entropy, 4 moments",
        "propagation": "response_surface",
        "runs": 118642,
        "runs_by_stage": {"response surface": 10642, "search": 0, "verification": 108000},
        "seconds": {"response surface": 8.123, "search": 2.04, "total": 10.163},
        "search": {
            "starts": 10,
            "evaluations": 180,
            "distinct_optima": 2,
            "optima": [
                {"log_likelihood": 262.512, "alpha": {}, "starts": 7},
                {"log_likelihood": 245.9, "alpha": {}, "starts": 3},
            ],
            "edm": 1e-9,
            "converged": True,
        },
        "surface": {
            "converged": 107,
            "experiments": 108,
            "median_error": 0.0031,
            "worst_error": 0.0234,
        },
        "baselines": {
            "least_squares": {
                "parameters": {"c2_scale": 0.93},
                "rmse": 0.0213,
                "log_likelihood": 201.0,
            },
            "circe": {"alpha": {"c2_scale.mean": 0.92}, "log_likelihood": 230.5},
        },
        "warnings": [
            {"about": "bound", "message": "c2_scale.sd is on its bound", "remedy": "lower it"}
        ],
        "sound": True,
        "experiments": [
            experiment("1", 0.5),
            experiment("2", 0.001),
            experiment("3", 0.4),
            experiment("4", 0.99),
            experiment("5", None, status="not_realizable", log_density=None),
        ],
        **changes,
    }
