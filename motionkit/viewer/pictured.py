"""Widgets with a picture of themselves, for pages that run nothing."""

from __future__ import annotations

import base64


class Pictured:
    """To be named before a widget's class: beside the live widget stands `still()`, the bytes of a PNG.

    about: what a terminal is told, a noun.
    """

    about = "a widget"

    def _repr_mimebundle_(self, **more: object) -> dict:
        """The live widget, and beside it the picture."""
        bundle = super()._repr_mimebundle_(**more) or {}
        bundle = bundle[0] if isinstance(bundle, tuple) else bundle  # anywidget gives its metadata too
        png, told = base64.b64encode(self.still()).decode(), f"({self.about}: run this cell)"
        return {**bundle, "image/png": png, "text/plain": told}
