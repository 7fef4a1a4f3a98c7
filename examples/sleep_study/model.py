"""The reaction time of a person who sleeps too little: a straight line in the days."""


def reaction(days, start, slope):
    return start + slope * days
