"""How results are shown; nothing here computes one.

A document is the content of a result's JSON file. It becomes a `Content`
(`aleator.results.printed`): sections of sentences, tables and charts. A `Chart` is a set of marks
on axes, drawn from named columns (`Series`). Four writers show a content: as plain text
(`results.printed`), on the terminal (`terminal`), as report.html with Bokeh (`page`,
`interactive`), and as figures of matplotlib (`axes`, `figures`). The sentences and tables of an
identification are made in `identification`, those of other results in `uncertainty`, `models`,
`planning` and `predictions`.
"""
