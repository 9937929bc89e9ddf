"""The rig's model beside the rig: simulated over short windows, its error held against the noise."""
