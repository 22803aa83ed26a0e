"""Looking at motion: a live player, figures that stay in saved notebooks, and strips for print.

The heavy libraries behind them (anywidget, plotly, matplotlib) are imported only when a name is first used.
"""

from __future__ import annotations

_HOMES = {
    "Player": "player",
    "save_html": "player",
    "scene": "scenes",
    "strip": "plots",
    "still": "plots",
    "still_png": "plots",
    "still_jpeg": "plots",
    "plot_trajectory": "plots",
    "plot_curves": "plots",
    "style_axes": "plots",
    "LossCurve": "widgets",
    "Live": "widgets",
}
__all__ = [*_HOMES, "colours"]


def __getattr__(name: str) -> object:
    from importlib import import_module

    if name in _HOMES:
        return getattr(import_module(f".{_HOMES[name]}", __name__), name)
    if name == "colours":
        return import_module(".colours", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
