"""Optical navigation: what images say about where the camera is."""
