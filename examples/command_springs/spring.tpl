! the input file of one run: what stands in double braces is replaced by a number
force     = {{force}}
stiffness = {{stiffness:.17g}}
