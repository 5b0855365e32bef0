"""Formats of networks. A module has ``write``."""
