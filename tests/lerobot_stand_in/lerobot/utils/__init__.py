"""Errors, decorators and plugins."""
