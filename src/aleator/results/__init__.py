"""The result of an identification as plain data: its values, its law, its document, its text.

Three nouns: a `Result` holds all values, and is equal to what is read back from its file
(`result`, `values`); a *document* is the content of such a file, as dictionaries and lists, checked
when it is read (`documents`, `schema`); a `Content` is what a reader is shown, sentences and tables
made from a document (`printed`, `answer`).

`law` is the identified joint law, to sample from; `units` says how names appear with their units.
Nothing here can run a simulator or evaluate a likelihood.
"""
