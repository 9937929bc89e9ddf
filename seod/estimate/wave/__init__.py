"""`wave`: maximum likelihood of the plant on a window of the voltages applied and the positions measured."""
