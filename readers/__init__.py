"""What the user gives, read and checked: robot files and values of TOML; files written whole or not at all."""
