"""What the paper compares with: a law sampled, and a spline through the histogram."""
