"""Formats of datasets. A module has ``write``, and ``check`` where not every dataset fits."""
