"""What a sweep found: statistics, worst cases, reports and figures."""
