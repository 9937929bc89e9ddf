"""The sheet that a test department files: what an archive tells of one rig, in the standard's terms."""
