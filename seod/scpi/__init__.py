"""SCPI as instruments have it: parser and status without sockets, commands of the rig, a thin shell."""
