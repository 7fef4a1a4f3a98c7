"""How results are shown; nothing here computes one."""
