"""`seod paper`: the paper's figures and tables from the simulated rigs, by the daemon's own estimators."""
