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
    "facing_view": "inspectors",
    "feature_inspector": "inspectors",
    "plot_layouts": "feature_plots",
    "plot_paths": "feature_plots",
    "plot_paddle": "feature_plots",
    "rotation_explorer": "explorers",
    "fk_explorer": "explorers",
    "plot_gimbal": "gimbal",
    "plot_turned": "explorers",
    "plot_rotation_paths": "lessons",
    "plot_numbers": "lessons",
    "plot_from_side": "lessons",
    "STYLE_GROUPS": "style_plots",
    "plot_styles": "style_plots",
    "plot_phase": "style_plots",
    "cycle_mean": "style_plots",
    "gait_angles": "style_plots",
    "plot_joint_errors": "style_plots",
    "plot_speed_bands": "style_plots",
    "style_mixer": "mixer",
    "plot_arena": "arena_plots",
    "plot_clouds": "judging_plots",
    "cloud_explorer": "judging_plots",
    "plot_confusion": "judging_plots",
    "plot_film": "diffusion_plots",
    "plot_poses": "diffusion_plots",
    "plot_quality": "diffusion_plots",
    "slide": "diffusion_plots",
    "LossCurve": "loss_curve",
    "PromptBox": "prompt_box",
    "StyleLesson": "style_lesson",
    "Live": "live",
    "plot_similarity": "text_plots",
    "feature_map": "feature_maps",
    "embed": "feature_maps",
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
