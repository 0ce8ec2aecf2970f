"""Colours and hatches of the figures: told apart in print, and by colour-blind readers."""

from typing import Any

BLACK, GREY, PALE = "#1a1a1a", "#6b6b6b", "#d9d9d9"
BLUE, ORANGE, GREEN, RED = "#0b5394", "#d55e00", "#117733", "#a50f15"
FILLS = ("#4f81bd", "#f2c14e", "#8fbf8f", "#d98880", "#b8a1d9", "#c9c9c9", "#7fcdbb", "#e0a3c8")
LINES = (BLUE, ORANGE, GREEN, "#7b3fa0", RED, GREY, "#0e7c7b", "#b3478f")
"""Of thin lines: dark enough on white, and so bright enough where a dark page turns them about."""
EDGE: dict[str, Any] = {"edgecolor": BLACK, "linewidth": 0.4}
"""Of bars."""
REJECTED: dict[str, Any] = {"facecolor": "white", "edgecolor": RED, "hatch": "////"}
"""Look of what was left out."""
HATCHES = ("", "///", "...", "\\\\\\", "xx", "--", "oo", "++")
"""Beside colours, so that areas differ in black and white."""
AXES = (("x", "o", BLUE), ("y", "s", ORANGE), ("z", "^", GREEN))
"""Name, mark and colour of each component of a vector."""
