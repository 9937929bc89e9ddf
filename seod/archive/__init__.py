"""Catalogues of recordings: one row a segment, in Parquet, asked by SQL; the recordings stay the truth."""
