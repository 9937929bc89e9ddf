"""The gateway process: takes the rows, estimates, streams, records and serves. Never holds up the loop."""
