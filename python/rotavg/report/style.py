"""Colours that can be read on a light and on a dark page, and by people who see fewer of them."""

SECOND, THIRD, MUTED = "#4a86d8", "#e07b2a", "#8a94a3"
# Of residuals: blue fits, orange does not fit well, dark red does not fit.
COLOURS = ((0.0, "#5b93dd"), (0.5, "#f0a63a"), (1.0, "#cf2f1d"))
# Of an edge's verdict: a marker's colour and shape.
VERDICTS = {
    "inlier": {"color": SECOND, "symbol": "circle", "size": 5},
    "bridge": {"color": MUTED, "symbol": "square", "size": 8},
    "trusted": {"color": SECOND, "symbol": "star", "size": 8},
    "robust_weight": {
        "color": THIRD,
        "symbol": "x-thin",
        "size": 6,
        "line": {"color": THIRD, "width": 1.2},
    },
    "cycle_check": {"color": "#cf2f1d", "symbol": "diamond", "size": 7},
    "weak_part": {"color": "#9a63d6", "symbol": "triangle-up", "size": 8},
    "excluded": {"color": MUTED, "symbol": "x", "size": 7},
}
COLOUR_BAR = {
    "title": {"text": "deg"}, "thickness": 12, "outlinewidth": 0, "exponentformat": "power"
}  # fmt: skip
