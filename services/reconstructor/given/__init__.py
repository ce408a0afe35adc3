"""Captures that come with poses: one adapter for each convention."""
