"""What the documentation adds to Sphinx, one extension a module."""
