"""For tests of control software: a pytest plugin with a simulated rig and a daemon on a free port.

It is there wherever seod is installed (`pytest --fixtures`): `virtual_rig`, `seod_daemon`.
"""
