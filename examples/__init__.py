"""SPECs of runs, the figures of the paper and further ones with their claims,
and a page with a robot to drag."""
