"""What a controller learns of the ground under its wheels while it drives."""
