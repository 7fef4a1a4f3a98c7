"""From the law and the surfaces to the distribution of the outcomes, and to the likelihood."""
