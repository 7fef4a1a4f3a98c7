"""How results are shown and stored; nothing here computes a result."""
