"""The colors of the charts, each for light and for dark: Okabe and Ito's, and grays."""

BLUE, BLUE_DARK = "#0072b2", "#56b4e9"
VERMILION, VERMILION_DARK = "#d55e00", "#ff8f3f"
PICKED, PICKED_DARK = "#c77700", "#ffd166"
GREEN, GREEN_DARK = "#009e73", "#2fd1a2"
INK, INK_DARK = "#262626", "#e6e6e6"
TEXT, TEXT_DARK = "#404040", "#c6cdd5"
GRAY, GRAY_DARK = "#767676", "#9aa3ad"
LINE, LINE_DARK = "#a0a0a0", "#5d6772"
GRID, GRID_DARK = "#e9e9e9", "#2b333c"
WIDE, WIDE_DARK = "#cfe3f1", "#1d3d55"
NARROW, NARROW_DARK = "#7fb8dc", "#2f6f9f"
BAND, BAND_DARK = "#e4e4e4", "#303841"
PAPER, PAPER_DARK = "#ffffff", "#14181d"
# From the maximum of a likelihood outward.
HEIGHTS = ("#9ecae8", "#c6dff0", "#e3eff8", "#f6fafd")
HEIGHTS_DARK = ("#2d6b96", "#234f70", "#1b394f", "#162734")

PAIRS = (
    (BLUE, BLUE_DARK), (VERMILION, VERMILION_DARK), (PICKED, PICKED_DARK), (GREEN, GREEN_DARK),
    (INK, INK_DARK), (TEXT, TEXT_DARK), (GRAY, GRAY_DARK), (LINE, LINE_DARK), (GRID, GRID_DARK),
    (WIDE, WIDE_DARK), (NARROW, NARROW_DARK), (BAND, BAND_DARK), (PAPER, PAPER_DARK),
    *zip(HEIGHTS, HEIGHTS_DARK, strict=True),
)  # fmt: skip
"""(light, dark) of each color: the page changes one for the other, so all are distinct."""
