"""The supervisor: watches loop and gateway, writes neutral when the loop cannot. Standard library only."""
