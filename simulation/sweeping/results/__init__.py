"""Results of a sweep: statistics, worst cases, reports and figures."""
