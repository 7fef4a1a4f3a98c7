"""`make bench`: what Aleator must reach, against targets and peers."""
