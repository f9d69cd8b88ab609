"""Neurally directed program search."""
