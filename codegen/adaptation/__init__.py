"""C that learns parameters which change, such as a payload."""
