"""How results are shown; nothing here computes one.

A document becomes a `Content` once (`aleator.results.printed`): sections of sentences, tables and
charts. A `Chart` is marks on axes, drawn from named columns (`Series`). Four writers show it: plain
text (`results.printed`), the terminal (`terminal`), report.html with Bokeh (`page`,
`interactive`), and matplotlib's axes (`axes`, `figures`). What to say of an identification is in
`identification`, and of other answers in `uncertainty`, `models`, `planning` and `predictions`.
"""
