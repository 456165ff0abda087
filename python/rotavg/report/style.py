"""Colours that can be read on a light and on a dark page, and by people who see fewer of them."""

SECOND, THIRD, MUTED = "#4a86d8", "#e07b2a", "#8a94a3"
# Of residuals: blue fits, orange does not fit well, dark red does not fit.
COLOURS = ((0.0, "#5b93dd"), (0.5, "#f0a63a"), (1.0, "#cf2f1d"))
COLOUR_BAR = {
    "title": {"text": "deg"}, "thickness": 12, "outlinewidth": 0, "exponentformat": "power"
}  # fmt: skip
