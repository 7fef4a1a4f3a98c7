#!/bin/sh
# Stands for a simulator of yours: reads an input file, writes a result file, prints a log.
awk '
    /^force/ {force = $3}
    /^stiffness/ {stiffness = $3}
    END {
        if (stiffness <= 0) {print "stiffness must be positive" > "/dev/stderr"; exit 1}
        print "solved in 1 step"
        printf "travel = %.17g\n", force / stiffness > "result.txt"
    }' "$1"
