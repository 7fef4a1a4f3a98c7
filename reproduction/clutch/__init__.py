"""The paper's wet clutch, with synthetic measurements: Figs. 8 to 20 and Table 2."""
