"""What Aleator promises of its surroundings, tried: damaged files, kills and failing simulators."""
