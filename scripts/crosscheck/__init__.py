"""Repeats a dataset's grasp attempts in another physics engine and compares the labels. See docs/label-parity.md."""
