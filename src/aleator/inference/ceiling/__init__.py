"""The best possible law: the nonparametric maximum of the likelihood over all laws."""
