"""The paper's illustrative outcome of one normal parameter: Figs. 4 to 6."""
