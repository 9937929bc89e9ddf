"""The panel's process: a page for browsers, metrics, SCPI, Foxglove. It commands as any client does."""
