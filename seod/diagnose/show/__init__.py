"""Where a simulation fails: the residual over states, input, time, frequency and the phase of a cycle."""
