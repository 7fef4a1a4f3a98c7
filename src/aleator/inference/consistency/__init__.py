"""Whether a fitted model is consistent with its experiments.

Each `Column` of the table is something that residuals may depend on (`columns.py`). A `Battery`
makes statistics of the residuals of a fit (`battery.py`), and a `Judgement` says by replicates how
improbable they are, each and together (`judged.py`). What contradicts the model becomes a sentence
with a remedy (`sentences.py`).
"""
