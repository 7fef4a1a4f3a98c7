"""The result of an identification as plain data: its values, its law, its document, its text.

Three nouns. A `Result` holds all values, and equals what is read back from its file (`result`,
`values`). A *document* is the content of such a file, as dictionaries and lists, which are checked
when they are read (`documents`, `schema`). A `Content` is what a reader sees: sentences and tables
made from a document (`printed`, `answer`).

`law` is the identified joint law, from which values can be drawn. `units` decides how names are
shown with their units. Nothing in this package runs a simulator or evaluates a likelihood.
"""
